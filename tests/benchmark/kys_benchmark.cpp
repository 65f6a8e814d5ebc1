// SPDX-License-Identifier: BSD-3-Clause
// What a distance costs: per pair and per search through N candidates, for every mode, against
// plain Hamming distance in the same run.
//
// Two made-up frames of one scene stand in for real ones. Descriptors of different points differ in
// about 92 of 256 bits, as neighbouring ORB features do, those of the same point in about 28.
// Features are in image order, so that a feature's neighbours in the list are its neighbours in the
// image: segments are runs of 100 features, two in twenty of them move above the gate, and one
// feature in ten has no label. Candidates of a feature are neighbours within 60; for three features
// in four the true match is among them.

#include <benchmark/benchmark.h>
#include <kys/kys.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace {

constexpr std::size_t kFeatures = 2000;

struct Frame {
  std::vector<kys::Descriptor> descriptors;
  std::vector<kys::Prior> priors;
};

kys::Prior prior_at(std::size_t i, std::mt19937& random) {
  const auto segment = static_cast<std::int32_t>(i / 100);
  const auto label = static_cast<std::uint16_t>(segment % 2 == 0 ? 100 + segment : 2);
  const float motion = segment % 10 == 9 ? 30.0f : segment % 10 == 7 ? 3.0f : 0.0f;
  const auto scale = 1e5f * static_cast<float>(1 + segment);
  return random() % 10 == 0 ? kys::Prior{}
                            : kys::make_prior(label, segment, scale, motion, motion > 0);
}

void flip_bits(kys::Descriptor& d, int count, std::mt19937& random) {
  for (int i = 0; i < count; ++i) {
    const std::uint32_t bit = random() % 256;
    d.words[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  }
}

/// Same points whatever the seed.
Frame make_frame(unsigned seed) {
  std::mt19937 scene_random(1), random(seed);
  const kys::Descriptor scene;
  Frame frame;
  for (std::size_t i = 0; i < kFeatures; ++i) {
    kys::Descriptor d = scene;
    flip_bits(d, 60, scene_random);
    flip_bits(d, 15, random);
    frame.descriptors.push_back(d);
    frame.priors.push_back(prior_at(i, random));
  }
  return frame;
}

kys::DistanceModel make_model(kys::Mode mode, bool continuous = true) {
  kys::ModeOptions options;
  options.mode = mode;
  options.continuous = continuous;
  return {options, kys::load_label_space("coco_panoptic_133")};
}

using Candidates = std::vector<std::uint32_t>;

/// Candidate lists of 400 features spread over the image.
std::vector<Candidates> make_candidates(std::size_t n) {
  std::mt19937 random(11);
  std::vector<Candidates> lists;
  for (std::size_t q = 0; q < kFeatures; q += kFeatures / 400) {
    Candidates list;
    while (list.size() < n) {
      list.push_back(static_cast<std::uint32_t>((q + kFeatures + random() % 121 - 60) % kFeatures));
    }
    if (random() % 4 != 0) {
      list[random() % n] = static_cast<std::uint32_t>(q);
    }
    lists.push_back(list);
  }
  return lists;
}

/// The same, as pairs (feature, candidate).
std::vector<std::pair<std::uint32_t, std::uint32_t>> make_pairs() {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
  const auto lists = make_candidates(25);
  for (std::size_t q = 0; q < lists.size(); ++q) {
    for (const std::uint32_t c : lists[q]) {
      pairs.emplace_back(static_cast<std::uint32_t>(q * kFeatures / 400), c);
    }
  }
  return pairs;
}

void per_pair(benchmark::State& state, const std::size_t pairs) {
  state.counters["ns/pair"] = benchmark::Counter(
      static_cast<double>(pairs) * 1e-9,
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void PairHamming(benchmark::State& state) {
  const Frame a = make_frame(2), b = make_frame(3);
  const auto pairs = make_pairs();
  for (auto _ : state) {
    int sum = 0;
    for (const auto& [q, c] : pairs) sum += kys::hamming(a.descriptors[q], b.descriptors[c]);
    benchmark::DoNotOptimize(sum);
  }
  per_pair(state, pairs.size());
}

void PairPortable(benchmark::State& state) {
  const Frame a = make_frame(2), b = make_frame(3);
  const auto pairs = make_pairs();
  for (auto _ : state) {
    int sum = 0;
    for (const auto& [q, c] : pairs) {
      sum += kys::detail::popcount_portable(a.descriptors[q], b.descriptors[c]);
    }
    benchmark::DoNotOptimize(sum);
  }
  per_pair(state, pairs.size());
}

/// Every pair in full, or with the second best so far as its bound.
void PairMode(benchmark::State& state, kys::Mode mode, bool continuous, bool bounded,
              bool counted) {
  const kys::DistanceModel model = make_model(mode, continuous);
  const Frame a = make_frame(2), b = make_frame(3);
  const auto pairs = make_pairs();
  kys::Statistics statistics;
  for (auto _ : state) {
    float sum = 0;
    float best = kys::kRejected, second = kys::kRejected;
    std::uint32_t query = 0;
    for (const auto& [q, c] : pairs) {
      if (q != query) {
        query = q;
        sum += std::min(best + second, 300.0f);
        best = second = kys::kRejected;
      }
      const float bound = bounded ? second : kys::kRejected;
      const kys::Distance d = model.evaluate(a.descriptors[q], a.priors[q], b.descriptors[c],
                                             b.priors[c], kys::Context::kTemporal, bound);
      if (counted) statistics.count(d.tier);
      if (d.value < best) {
        second = best;
        best = d.value;
      } else if (d.value < second) {
        second = d.value;
      }
    }
    benchmark::DoNotOptimize(sum);
  }
  benchmark::DoNotOptimize(statistics);
  per_pair(state, pairs.size());
}

/// What a matcher without kys writes: best and second best by Hamming distance.
void SearchHamming(benchmark::State& state) {
  const auto n = static_cast<std::size_t>(state.range(0));
  const Frame a = make_frame(2), b = make_frame(3);
  const auto lists = make_candidates(n);
  for (auto _ : state) {
    int sum = 0;
    for (std::size_t i = 0; i < lists.size(); ++i) {
      const std::size_t q = i * kFeatures / 400;
      int best = 256, second = 256;
      std::uint32_t index = 0;
      for (const std::uint32_t c : lists[i]) {
        const int d = kys::hamming(a.descriptors[q], b.descriptors[c]);
        if (d < best) {
          second = best;
          best = d;
          index = c;
        } else if (d < second) {
          second = d;
        }
      }
      sum += best + second + static_cast<int>(index);
    }
    benchmark::DoNotOptimize(sum);
  }
  per_pair(state, lists.size() * n);
}

void ManyHamming(benchmark::State& state, kys::detail::HammingKernel kernel) {
  const auto n = static_cast<std::size_t>(state.range(0));
  const Frame a = make_frame(2), b = make_frame(3);
  const auto lists = make_candidates(n);
  std::vector<std::int16_t> distances(n);
  for (auto _ : state) {
    for (std::size_t i = 0; i < lists.size(); ++i) {
      kernel.run(a.descriptors[i * kFeatures / 400], b.descriptors.data(), lists[i].data(), n,
                 distances.data());
      benchmark::DoNotOptimize(distances.data());
      benchmark::ClobberMemory();
    }
  }
  per_pair(state, lists.size() * n);
}

void SearchMode(benchmark::State& state, kys::Mode mode) {
  const kys::DistanceModel model = make_model(mode);
  const auto n = static_cast<std::size_t>(state.range(0));
  const Frame a = make_frame(2), b = make_frame(3);
  const auto lists = make_candidates(n);
  kys::Statistics statistics;
  for (auto _ : state) {
    float sum = 0;
    for (std::size_t i = 0; i < lists.size(); ++i) {
      const std::size_t q = i * kFeatures / 400;
      const kys::BestTwo best =
          model.best_two(a.descriptors[q], a.priors[q], b.descriptors, b.priors, lists[i],
                         kys::Context::kTemporal, statistics);
      sum += best.best.value + best.second.value + static_cast<float>(best.index);
    }
    benchmark::DoNotOptimize(sum);
  }
  state.counters["skipped"] =
      static_cast<double>(statistics.skipped()) / static_cast<double>(statistics.total());
  per_pair(state, lists.size() * n);
}

void MakePrior(benchmark::State& state) {
  for (auto _ : state) {
    for (std::uint32_t i = 0; i < kFeatures; ++i) {
      benchmark::DoNotOptimize(kys::make_prior(1, 1, 10.0f, static_cast<float>(i % 7), false));
    }
  }
  per_pair(state, kFeatures);
}

void register_modes() {
  for (const auto& kernel : kys::detail::hamming_kernels()) {
    const std::string name = "ManyHamming/" + std::string(kernel.name);
    benchmark::RegisterBenchmark(name.c_str(), ManyHamming, kernel)->Arg(8)->Arg(25)->Arg(100);
  }
  for (const kys::Mode mode : kys::all_modes()) {
    const std::string name(kys::mode_name(mode));
    benchmark::RegisterBenchmark(("PairMode/" + name).c_str(), PairMode, mode, true, false, true);
    benchmark::RegisterBenchmark(("PairBounded/" + name).c_str(), PairMode, mode, true, true, true);
    benchmark::RegisterBenchmark(("SearchMode/" + name).c_str(), SearchMode, mode)
        ->Arg(8)
        ->Arg(25)
        ->Arg(100);
  }
  benchmark::RegisterBenchmark("PairMode/gates_only", PairMode, kys::Mode::kKys, false, false,
                               true);
  benchmark::RegisterBenchmark("PairUncounted/kys", PairMode, kys::Mode::kKys, true, false, false);
}

}  // namespace

BENCHMARK(PairHamming);
BENCHMARK(PairPortable);
BENCHMARK(SearchHamming)->Arg(8)->Arg(25)->Arg(100);
BENCHMARK(MakePrior);

int main(int argc, char** argv) {
  register_modes();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
