// SPDX-License-Identifier: BSD-3-Clause
// Time of the ORB extractor, whole and by stage, on one KITTI frame if there is one (a synthetic
// texture of the same size otherwise). Build `features_benchmark`, run it on an idle machine.

#include <benchmark/benchmark.h>
#include <kys_slam/image_file.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "features/corner_detector.h"
#include "features/orb_descriptor.h"
#include "features/orb_extractor.h"
#include "features/quadtree.h"
#include "synthetic_images.h"

namespace {

using namespace kys_slam;

const GrayImage& frame(int camera) {
  const auto load = [](int c) {
    const char* elsewhere = std::getenv("KYS_SHARED_DATA_DIR");
    const std::filesystem::path data = elsewhere != nullptr ? elsewhere : KYS_SHARED_DATA_DIR;
    const auto path = data / "kitti_06_clip" / (c == 0 ? "image_0" : "image_1") / "000010.png";
    return std::filesystem::exists(path) ? read_gray(path) : test::Texture(7).render(1226, 370);
  };
  static const GrayImage images[2] = {load(0), load(1)};
  return images[camera];
}

/// The frame and what each stage needs from the ones before it.
struct Stages {
  ImagePyramid pyramid;
  std::vector<GrayImage> blurred;
  std::vector<std::vector<Corner>> corners, kept;

  Stages() {
    PyramidBuilder().build(frame(0), 1.2, 8, pyramid);
    double share = 2000 * (1 - 1 / 1.2) / (1 - std::pow(1 / 1.2, 8));
    for (const GrayImage& level : pyramid.levels) {
      blurred.emplace_back();
      DescriptorBlur().apply(level, blurred.back());
      corners.emplace_back();
      CornerDetector().detect(level, {}, corners.back());
      kept.push_back(spread(level, corners.back(), share));
      share /= 1.2;
    }
  }

  static std::vector<Corner> spread(const GrayImage& level, const std::vector<Corner>& corners,
                                    double wanted) {
    return distribute(corners, kOrbMargin, level.width() - kOrbMargin, kOrbMargin,
                      level.height() - kOrbMargin, static_cast<int>(wanted));
  }
};

const Stages& stages() {
  static const Stages s;
  return s;
}

void bm_pyramid(benchmark::State& state) {
  PyramidBuilder builder;
  ImagePyramid pyramid;
  builder.build(frame(0), 1.2, 8, pyramid);
  for (auto _ : state) builder.build(frame(0), 1.2, 8, pyramid);
}

void bm_corners(benchmark::State& state) {
  CornerDetector detector;
  std::vector<Corner> corners;
  std::size_t count = 0;
  for (auto _ : state) {
    count = 0;
    for (const GrayImage& level : stages().pyramid.levels) {
      detector.detect(level, {}, corners);
      count += corners.size();
    }
  }
  state.counters["corners"] = static_cast<double>(count);
}

void bm_distribution(benchmark::State& state) {
  const Stages& s = stages();
  for (auto _ : state) {
    for (std::size_t l = 0; l < s.kept.size(); ++l) {
      benchmark::DoNotOptimize(
          Stages::spread(s.pyramid.levels[l], s.corners[l], static_cast<double>(s.kept[l].size())));
    }
  }
}

void bm_blur(benchmark::State& state) {
  DescriptorBlur blur;
  GrayImage blurred;
  for (auto _ : state) {
    for (const GrayImage& level : stages().pyramid.levels) blur.apply(level, blurred);
  }
}

void bm_orientation(benchmark::State& state) {
  const Stages& s = stages();
  for (auto _ : state) {
    for (std::size_t l = 0; l < s.kept.size(); ++l) {
      for (const Corner& c : s.kept[l]) {
        benchmark::DoNotOptimize(orientation(s.pyramid.levels[l], c.x, c.y).angle());
      }
    }
  }
}

void bm_descriptors(benchmark::State& state) {
  const Stages& s = stages();
  for (auto _ : state) {
    for (std::size_t l = 0; l < s.kept.size(); ++l) {
      for (const Corner& c : s.kept[l]) {
        benchmark::DoNotOptimize(orb_descriptor(s.blurred[l], c.x, c.y, {0.6f, 0.8f}));
      }
    }
  }
}

void bm_image(benchmark::State& state) {
  OrbExtractor extractor{OrbOptions{}};
  FeatureSet features;
  for (auto _ : state) extractor.extract(frame(0), features);
  state.counters["features"] = static_cast<double>(features.size());
}

void bm_pair_on_two_threads(benchmark::State& state) {
  OrbExtractor extractors[2] = {OrbExtractor{OrbOptions{}}, OrbExtractor{OrbOptions{}}};
  FeatureSet features[2];
  for (auto _ : state) {
    std::thread right([&] { extractors[1].extract(frame(1), features[1]); });
    extractors[0].extract(frame(0), features[0]);
    right.join();
  }
}

BENCHMARK(bm_pyramid)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_corners)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_distribution)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_blur)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_orientation)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_descriptors)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_image)->Unit(benchmark::kMillisecond);
BENCHMARK(bm_pair_on_two_threads)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

BENCHMARK_MAIN();
