// SPDX-License-Identifier: BSD-3-Clause
// What must hold for any pair, on random input.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <thread>
#include <tuple>
#include <utility>

#include "test_support.h"

namespace kys::test {
namespace {

std::vector<ModeOptions> variants() {
  std::vector<ModeOptions> all;
  for (const Mode mode : all_modes()) {
    all.push_back(options_of(mode));
    all.push_back(literal(mode));
  }
  ModeOptions odd = options_of(Mode::kKys);  // nothing here is a round number
  odd.eta = {0.913, 0.377, 0.291};
  odd.gamma = 0.611;
  odd.lambda = {0.31, 0.17, 0.033};
  all.push_back(odd);
  odd.gates = false;
  all.push_back(odd);
  odd.continuous = false;
  all.push_back(odd);
  return all;
}

struct Pair {
  Descriptor a, b;
  Prior pa, pb;
  Context context;
};

std::vector<Pair> random_pairs(std::uint32_t seed, int count) {
  RandomPairs random(seed);
  std::vector<Pair> pairs;
  for (int i = 0; i < count; ++i) {
    pairs.push_back({random.descriptor(), random.descriptor(), random.prior(), random.prior(),
                     random.context()});
  }
  return pairs;
}

Distance evaluate(const DistanceModel& model, const Pair& p, float bound = kRejected) {
  return model.evaluate(p.a, p.pa, p.b, p.pb, p.context, bound);
}

TEST(Property, Symmetry) {
  const auto pairs = random_pairs(1, 3000);
  for (const ModeOptions& options : variants()) {
    const DistanceModel model(options, three_classes());
    for (const Pair& p : pairs) {
      ASSERT_EQ(evaluate(model, p), model.evaluate(p.b, p.pb, p.a, p.pa, p.context));
    }
  }
}

TEST(Property, GrowsWithHammingDistance) {
  const auto pairs = random_pairs(2, 200);
  for (const ModeOptions& options : variants()) {
    const DistanceModel model(options, three_classes());
    for (const Pair& p : pairs) {
      float last = -1.0f;
      for (int d = 0; d <= 256; ++d) {
        const float now = value(model, d, p.pa, p.pb, p.context);
        ASSERT_GE(now, last);
        ASSERT_TRUE(now > last || now == kRejected);
        last = now;
      }
    }
  }
}

TEST(Property, NeverFallsWhenMotionGrows) {
  const auto pairs = random_pairs(3, 200);
  for (const ModeOptions& options : variants()) {
    const DistanceModel model(options, three_classes());
    for (Pair p : pairs) {
      float last = -1.0f;
      for (float mu = 0; mu <= 100; mu += 0.37f) {
        p.pa = make_prior(p.pa.label, p.pa.instance, p.pa.scale, mu, p.pa.dynamic != 0);
        const float now = evaluate(model, p).value;
        ASSERT_GE(now, last);
        last = now;
      }
    }
  }
}

TEST(Property, FactorsStayWithinTheBoundsOfTheirTier) {
  ModeOptions options = literal(Mode::kPanoptic);
  const DistanceModel model(options, three_classes());
  const double s_largest = 200 / options.s_max;
  for (const Pair& p : random_pairs(4, 20000)) {
    const double d = hamming(p.a, p.b);
    const Distance distance = evaluate(model, p);
    double low = d, high = d;
    if (distance.tier == Tier::kSameInstance) {
      low = high = 0.75 * d;
    } else if (distance.tier == Tier::kCrossInstance) {
      low = 0.75 * d;
      high = 0.85 * d;
    } else if (distance.tier == Tier::kCrossClass) {
      low = (0.7 + 0.2 * 100 / 155) * d;
      high = (0.8 + 0.2 * s_largest) * d;
    }
    ASSERT_GE(distance.value, low - 1e-4);
    ASSERT_LE(distance.value, high + 1e-4);
  }
}

/// The table of modes, written down once more: in double, as a reader of the paper would.
double from_the_paper(const ModeOptions& o, const Pair& p, const LabelSpace& space) {
  const double d = hamming(p.a, p.b);
  if (o.mode == Mode::kScaled) return o.s * d;
  if (p.pa.label == kVoidLabel || p.pb.label == kVoidLabel) return d;
  const double rejected = kRejected;
  const double s = space.distance(p.pa.label, p.pb.label);
  const bool same_class = p.pa.label == p.pb.label;
  const bool same_instance = same_class && p.pa.instance == p.pb.instance;
  const double largest = std::max(p.pa.scale, p.pb.scale);
  const double da = largest == 0 ? 0 : std::abs(double{p.pa.scale} - p.pb.scale) / largest;
  double phi = d * (o.eta[0] + o.eta[1] * s / o.s_max + o.eta[2] * da);
  if (same_class) phi = d * (o.gamma + o.eta[2] * da);
  if (same_instance) phi = d * o.gamma;
  if (o.normalize) phi /= o.gamma;
  const double mu = std::max(p.pa.motion, p.pb.motion);
  const double lambda = same_instance ? o.lambda[2] : same_class ? o.lambda[1] : o.lambda[0];
  switch (o.mode) {
    case Mode::kStock:
    case Mode::kMask:
    case Mode::kScaled:  // above
      return d;
    case Mode::kHardMismatch:
      return same_class ? d : rejected;
    case Mode::kSoftFilter:
      return s >= o.tau ? rejected : d;
    case Mode::kSemantic:
      return o.alpha * d + (1 - o.alpha) * s;
    case Mode::kPanoptic:
      return phi;
    case Mode::kKys:
      break;
    case Mode::kVerified:
      if (o.gates && p.context == Context::kTemporal && mu > 100 * o.gate_belief) return rejected;
      return o.continuous ? phi * (1 + lambda * std::log(1 + mu)) : d;
  }
  const bool gated = o.gates && p.context != Context::kInstance;
  if (gated && mu > (p.context == Context::kStereo ? o.gate_stereo : o.gate_temporal)) {
    return rejected;
  }
  return o.continuous ? phi * (1 + lambda * std::log(1 + mu)) : d;
}

TEST(Property, EveryModeIsThePapersFormula) {
  const auto pairs = random_pairs(14, 5000);
  for (const ModeOptions& options : variants()) {
    const LabelSpace space = three_classes();
    const DistanceModel model(options, space);
    for (const Pair& p : pairs) {
      const double expected = from_the_paper(options, p, space);
      const float got = evaluate(model, p).value;
      if (expected == kRejected) {
        ASSERT_EQ(got, kRejected);
      } else {
        ASSERT_NEAR(got, expected, 1e-6 * (1 + expected)) << mode_name(options.mode);
      }
    }
  }
}

TEST(Property, KysWithoutMotionIsPanoptic) {
  for (const bool normalize : {true, false}) {
    ModeOptions kys = options_of(Mode::kKys);
    ModeOptions panoptic = options_of(Mode::kPanoptic);
    kys.normalize = panoptic.normalize = normalize;
    const DistanceModel first(kys, three_classes());
    const DistanceModel second(panoptic, three_classes());
    for (Pair p : random_pairs(5, 5000)) {
      p.pa = make_prior(p.pa.label, p.pa.instance, p.pa.scale, 0, false);
      p.pb = make_prior(p.pb.label, p.pb.instance, p.pb.scale, 0, false);
      ASSERT_EQ(evaluate(first, p), evaluate(second, p));
    }
  }
}

TEST(Property, SemanticWithAlphaOneIsStock) {
  ModeOptions options = options_of(Mode::kSemantic);
  options.alpha = 1;
  const DistanceModel semantic(options, three_classes());
  const DistanceModel stock;
  for (const Pair& p : random_pairs(6, 5000)) {
    ASSERT_EQ(evaluate(semantic, p).value, evaluate(stock, p).value);
  }
}

TEST(Property, StockIsTheIntegerHammingDistance) {
  const DistanceModel stock;
  for (const Pair& p : random_pairs(7, 5000)) {
    int bits = 0;
    for (int i = 0; i < 256; ++i) {
      bits += ((p.a.words[i / 64] ^ p.b.words[i / 64]) >> (i % 64)) & 1;
    }
    ASSERT_EQ(hamming(p.a, p.b), bits);
    ASSERT_EQ(detail::popcount_portable(p.a, p.b), bits);
    ASSERT_EQ(evaluate(stock, p), (Distance{static_cast<float>(bits), Tier::kBypassed}));
    ASSERT_EQ(evaluate(stock, p, 1.0f).value, static_cast<float>(bits));
  }
}

TEST(Property, EveryHammingKernelCountsTheSame) {
  RandomPairs random(13);
  std::vector<Descriptor> descriptors = {with_bits(0), with_bits(256)};
  while (descriptors.size() < 50) descriptors.push_back(random.descriptor());
  std::vector<std::uint32_t> candidates(37);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    candidates[i] = static_cast<std::uint32_t>(i * 7 % 50);
  }
  ASSERT_FALSE(detail::hamming_kernels().empty());
  for (const detail::HammingKernel& kernel : detail::hamming_kernels()) {
    for (std::size_t count = 0; count <= candidates.size(); ++count) {
      const Descriptor query = count == 0 ? Descriptor{} : descriptors[count];
      std::vector<std::int16_t> distances(candidates.size() + 1, -7);
      kernel.run(query, descriptors.data(), candidates.data(), count, distances.data());
      for (std::size_t i = 0; i < count; ++i) {
        ASSERT_EQ(distances[i], hamming(query, descriptors[candidates[i]])) << kernel.name;
      }
      ASSERT_EQ(distances[count], -7) << kernel.name << " wrote beyond the end";
    }
  }
}

TEST(Property, TheShortcutIsExact) {
  const auto pairs = random_pairs(8, 4000);
  RandomPairs random(9);
  for (const ModeOptions& options : variants()) {
    const DistanceModel model(options, three_classes());
    int skipped = 0;
    for (const Pair& p : pairs) {
      const Distance exact = evaluate(model, p);
      ASSERT_GE(exact.value, model.lower_bound_factor() * static_cast<float>(hamming(p.a, p.b)));
      // A bound at random, and the tightest ones there are.
      for (const float bound :
           {random.uniform(0, 200), exact.value, std::nextafter(exact.value, 1e9f), 0.0f}) {
        const Distance bounded = evaluate(model, p, bound);
        if (exact.value < bound) {
          ASSERT_EQ(bounded, exact);
        } else {
          ASSERT_GE(bounded.value, bound);
        }
        skipped += bounded.tier == Tier::kSkipped;
      }
    }
    const bool native = options.mode == Mode::kStock || options.mode == Mode::kMask;
    EXPECT_EQ(skipped > 1000, !native) << mode_name(options.mode);
  }
}

/// The definition best_two() is an optimisation of.
BestTwo reference_search(const DistanceModel& model, const Descriptor& query, const Prior& prior,
                         const std::vector<Descriptor>& descriptors,
                         const std::vector<Prior>& priors,
                         const std::vector<std::uint32_t>& candidates, Context context) {
  std::vector<std::pair<Distance, std::uint32_t>> found;
  for (const std::uint32_t i : candidates) {
    const Prior other = priors.empty() ? Prior{} : priors[i];
    const Distance d = model.evaluate(query, prior, descriptors[i], other, context);
    if (d.value < kRejected) found.emplace_back(d, i);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first.value < b.first.value; });
  BestTwo best;
  if (!found.empty()) std::tie(best.best, best.index) = found[0];
  if (found.size() > 1) std::tie(best.second, best.second_index) = found[1];
  return best;
}

TEST(Property, BestTwoIsTheSearchOneByOne) {
  RandomPairs random(10);
  std::vector<Descriptor> descriptors;
  std::vector<Prior> priors;
  for (int i = 0; i < 300; ++i) {
    descriptors.push_back(i % 3 == 2 ? descriptors.back() : random.descriptor());  // many equals
    priors.push_back(random.prior());
  }
  // Distances are taken 128 at a time.
  constexpr std::array<std::uint32_t, 3> kLong = {128, 129, 300};
  for (const ModeOptions& options : variants()) {
    const DistanceModel model(options, three_classes());
    for (std::uint32_t round = 0; round < 150; ++round) {
      std::vector<std::uint32_t> candidates(round < 120 ? round % 40 : kLong[round % 3]);
      for (std::size_t i = 0; i < candidates.size(); ++i) {
        candidates[i] = static_cast<std::uint32_t>((round * 7 + i * (1 + round % 5)) % 300);
      }
      const Descriptor query = random.descriptor();
      const Prior prior = random.prior();
      const Context context = random.context();
      const std::vector<Prior>& used = round % 10 == 9 ? std::vector<Prior>{} : priors;
      Statistics statistics;
      const BestTwo got =
          model.best_two(query, prior, descriptors, used, candidates, context, statistics);
      ASSERT_EQ(got, reference_search(model, query, prior, descriptors, used, candidates, context));
      ASSERT_EQ(statistics.total(), candidates.size());
    }
  }
}

TEST(Property, BestTwoOfRejectedCandidatesIsNobody) {
  const DistanceModel model(options_of(Mode::kKys), three_classes());
  const std::vector<Descriptor> descriptors(4);
  const std::vector<Prior> priors(4, make_prior(1, 1, 0, 50, true));
  const std::vector<std::uint32_t> candidates = {0, 1, 2, 3};
  Statistics statistics;
  const BestTwo best = model.best_two({}, make_prior(1, 1, 0, 0, false), descriptors, priors,
                                      candidates, Context::kTemporal, statistics);
  EXPECT_EQ(best, BestTwo{});
  EXPECT_EQ(statistics.gated(), 4u);
}

TEST(Property, StatisticsCountEveryPairOnce) {
  const DistanceModel model(options_of(Mode::kKys), three_classes());
  Statistics statistics;
  std::array<std::uint64_t, kTierCount> expected{};
  for (const Pair& p : random_pairs(11, 5000)) {
    const Distance d = model.evaluate(p.a, p.pa, p.b, p.pb, p.context, 90.0f, statistics);
    ++expected[static_cast<std::size_t>(d.tier)];
  }
  EXPECT_EQ(statistics.pairs, expected);
  EXPECT_EQ(statistics.total(), 5000u);
  for (const Tier tier : {Tier::kSameInstance, Tier::kCrossInstance, Tier::kCrossClass,
                          Tier::kBypassed, Tier::kGated, Tier::kSkipped}) {
    EXPECT_GT(statistics.evaluated(tier), 0u);
  }
  EXPECT_EQ(statistics.filtered(), 0u);
  statistics.accept(Tier::kCrossClass);
  Statistics sum = statistics;
  sum += statistics;
  EXPECT_EQ(sum.total(), 10000u);
  EXPECT_EQ(sum.accepted_of(Tier::kCrossClass), 2u);
}

TEST(Property, OneModelServesManyThreads) {
  const DistanceModel model(options_of(Mode::kKys), three_classes());
  const auto pairs = random_pairs(12, 2000);
  std::vector<Distance> expected;
  for (const Pair& p : pairs) expected.push_back(evaluate(model, p));
  std::array<int, 4> differences{};
  std::vector<std::thread> threads;
  for (int& count : differences) {
    threads.emplace_back([&model, &pairs, &expected, &count] {
      for (std::size_t i = 0; i < pairs.size(); ++i) {
        count += !(evaluate(model, pairs[i]) == expected[i]);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(std::accumulate(differences.begin(), differences.end(), 0), 0);
}

}  // namespace
}  // namespace kys::test
