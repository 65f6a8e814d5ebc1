// SPDX-License-Identifier: BSD-3-Clause
// What a query and an update of the place index cost, against the size of the map.
//
// Made-up descriptors as uneven as real ones: each is one of 3000 patterns with 70 bits turned
// over, so that different points differ in about 100 of 256 bits and buckets are of very different
// sizes. Every landmark is seen by five keyframes; a query sees 40 % of a keyframe's landmarks
// again, with noise of 30 bits.

#include <benchmark/benchmark.h>

#include <memory>

#include "place_fixtures.h"

namespace {

using namespace kys_slam;
using testing::random_descriptor;
using testing::with_flips;

constexpr std::uint32_t kPerKeyframe = 250;  // new landmarks

struct BenchmarkMap {
  PlaceIndex index;
  std::vector<LandmarkView> landmarks;
  FrameFeatures query;
};

BenchmarkMap make_map(std::uint32_t landmarks) {
  std::mt19937_64 random(1);
  std::vector<kys::Descriptor> patterns(3000);
  for (kys::Descriptor& d : patterns) d = random_descriptor(random);
  BenchmarkMap map;
  const std::uint32_t keyframes = landmarks / kPerKeyframe;
  ChangeSet changes;
  for (std::uint32_t i = 0; i < landmarks; ++i) {
    LandmarkView view;
    view.descriptor = with_flips(patterns[random() % patterns.size()], 70, random);
    for (std::uint32_t k = i / kPerKeyframe; k < i / kPerKeyframe + 5; ++k) {
      view.observers.push_back(KeyFrameId{k});
    }
    changes.landmarks.emplace_back(LandmarkId{i}, view);
    map.landmarks.push_back(view);
  }
  for (std::uint32_t k = 0; k < keyframes; ++k) {
    changes.keyframes.emplace_back(KeyFrameId{k}, KeyFrameView{});
    for (std::uint32_t n = std::max(k, 5u) - 5; n < std::min(k + 6, keyframes); ++n) {
      if (n != k) changes.keyframes.back().second.neighbours.push_back(KeyFrameId{n});
    }
  }
  map.index.apply(changes);
  std::vector<kys::Descriptor> query;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    const std::uint32_t seen = (keyframes / 2) * kPerKeyframe + i % (5 * kPerKeyframe);
    query.push_back(i % 5 < 2 ? with_flips(map.landmarks[seen].descriptor, 30, random)
                              : with_flips(patterns[random() % patterns.size()], 70, random));
  }
  map.query = testing::features_of(query);
  return map;
}

void query(benchmark::State& state) {
  const BenchmarkMap map = make_map(static_cast<std::uint32_t>(state.range(0)));
  const kys::DistanceModel model;
  kys::Statistics statistics;
  for (auto _ : state) {
    benchmark::DoNotOptimize(map.index.query(map.query, model, statistics, {}, 5));
  }
  const auto n = static_cast<double>(state.iterations());
  state.counters["compared"] = static_cast<double>(statistics.total()) / n;
  state.counters["bytes_per_landmark"] =
      static_cast<double>(map.index.bytes()) / static_cast<double>(state.range(0));
}

/// A step of the back end: a thousand landmarks touched, of which `changed` got a new descriptor.
void update(benchmark::State& state) {
  BenchmarkMap map = make_map(200000);
  std::mt19937_64 random(2);
  const auto changed = static_cast<std::size_t>(state.range(0));
  std::vector<ChangeSet> steps(2);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    const std::uint32_t id = 100000 + i;
    LandmarkView view = map.landmarks[id];
    steps[0].landmarks.emplace_back(LandmarkId{id}, view);
    if (i < changed) {
      view.descriptor = random_descriptor(random);
      view.observers.push_back(KeyFrameId{600});
    }
    steps[1].landmarks.emplace_back(LandmarkId{id}, view);
  }
  std::size_t step = 0;
  for (auto _ : state) map.index.apply(steps[++step % 2]);
}

BENCHMARK(query)->Arg(10000)->Arg(50000)->Arg(200000)->Unit(benchmark::kMillisecond);
BENCHMARK(update)->Arg(0)->Arg(300)->Arg(1000)->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
