// What a distance costs: per pair and per search through N candidates, for every mode, against
// plain Hamming distance in the same run. The frames are made up: descriptors at the distances that
// neighbouring ORB features have (median about 90 bits), priors of a street scene (20 segments, one
// keypoint in ten without a label, one in seven on a mover).

#include <benchmark/benchmark.h>
#include <kys/kys.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace {

constexpr std::size_t kFeatures = 2000;

struct Frame {
  std::vector<kys::Descriptor> descriptors;
  std::vector<kys::Prior> priors;
};

kys::Prior random_prior(std::mt19937& random) {
  const auto segment = static_cast<std::int32_t>(random() % 20);
  const auto label = static_cast<std::uint16_t>(segment < 10 ? 100 + 3 * segment : 2);
  const float motion = segment >= 17 ? 2.0f * static_cast<float>(segment - 15) * 3 : 0.0f;
  const auto scale = 1e5f * static_cast<float>(1 + segment);
  return random() % 10 == 0 ? kys::Prior{}
                            : kys::make_prior(label, segment, scale, motion, motion > 0);
}

Frame make_frame(unsigned seed) {
  std::mt19937 random(seed);
  std::mt19937_64 random_word(1);  // the same scene for all frames
  Frame frame;
  kys::Descriptor scene;
  for (auto& word : scene.words) word = random_word();
  for (std::size_t i = 0; i < kFeatures; ++i) {
    kys::Descriptor d = scene;
    for (int flips = 0; flips < 60; ++flips) {
      const std::uint32_t bit = random() % 256;
      d.words[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    }
    frame.descriptors.push_back(d);
    frame.priors.push_back(random_prior(random));
  }
  return frame;
}

kys::DistanceModel make_model(kys::Mode mode, bool continuous = true) {
  kys::ModeOptions options;
  options.mode = mode;
  options.continuous = continuous;
  return {options, kys::load_label_space("coco_panoptic_133")};
}

/// Pairs (query, candidate) in the order a matcher meets them: one query, then its neighbours.
std::vector<std::pair<std::uint32_t, std::uint32_t>> make_pairs() {
  std::mt19937 random(7);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs;
  for (std::uint32_t q = 0; q < 400; ++q) {
    for (int k = 0; k < 25; ++k) {
      pairs.emplace_back(q, static_cast<std::uint32_t>(random() % kFeatures));
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

/// Every pair in full: no bound.
void PairMode(benchmark::State& state, kys::Mode mode, bool continuous) {
  const kys::DistanceModel model = make_model(mode, continuous);
  const Frame a = make_frame(2), b = make_frame(3);
  const auto pairs = make_pairs();
  kys::Statistics statistics;
  for (auto _ : state) {
    float sum = 0;
    for (const auto& [q, c] : pairs) {
      const kys::Distance d =
          model.evaluate(a.descriptors[q], a.priors[q], b.descriptors[c], b.priors[c],
                         kys::Context::kTemporal, kys::kRejected, statistics);
      sum += std::min(d.value, 300.0f);
    }
    benchmark::DoNotOptimize(sum);
  }
  benchmark::DoNotOptimize(statistics);
  per_pair(state, pairs.size());
}

std::vector<std::vector<std::uint32_t>> make_candidates(std::size_t n) {
  std::mt19937 random(11);
  std::vector<std::vector<std::uint32_t>> lists(400, std::vector<std::uint32_t>(n));
  for (auto& list : lists) {
    for (auto& index : list) index = static_cast<std::uint32_t>(random() % kFeatures);
  }
  return lists;
}

/// What a matcher without kys writes: best and second best by Hamming distance.
void SearchHamming(benchmark::State& state) {
  const auto n = static_cast<std::size_t>(state.range(0));
  const Frame a = make_frame(2), b = make_frame(3);
  const auto lists = make_candidates(n);
  for (auto _ : state) {
    int sum = 0;
    for (std::size_t q = 0; q < lists.size(); ++q) {
      int best = 256, second = 256;
      std::uint32_t index = 0;
      for (const std::uint32_t c : lists[q]) {
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

void SearchMode(benchmark::State& state, kys::Mode mode) {
  const kys::DistanceModel model = make_model(mode);
  const auto n = static_cast<std::size_t>(state.range(0));
  const Frame a = make_frame(2), b = make_frame(3);
  const auto lists = make_candidates(n);
  kys::Statistics statistics;
  for (auto _ : state) {
    float sum = 0;
    for (std::size_t q = 0; q < lists.size(); ++q) {
      const kys::BestTwo best =
          model.best_two(a.descriptors[q], a.priors[q], b.descriptors, b.priors, lists[q],
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
  for (const kys::Mode mode : kys::all_modes()) {
    const std::string name(kys::mode_name(mode));
    benchmark::RegisterBenchmark(("PairMode/" + name).c_str(), PairMode, mode, true);
    benchmark::RegisterBenchmark(("SearchMode/" + name).c_str(), SearchMode, mode)
        ->Arg(8)
        ->Arg(25)
        ->Arg(100);
  }
  benchmark::RegisterBenchmark("PairMode/gates_only", PairMode, kys::Mode::kKys, false);
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
