// SPDX-License-Identifier: BSD-3-Clause
// Milliseconds per frame of fusion (both cameras), encoding, and of what the tracker pays for
// reading: open + 2 x 2000 look-ups.
#include <benchmark/benchmark.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/prior_writer.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "priors/fusion/fuse.h"
#include "synthetic_scene.h"

namespace kys_slam {
namespace {

CameraPerception make_frame(const StereoCamera& camera) {
  using V = Eigen::Vector3d;
  CameraPerception p = synthetic::street(camera, synthetic::motion(0.001, 0.005, 0, 0, 0, -0.9),
                                         {{300, 190, 380, 240, 15, V(0.5, 0, 0)},
                                          {500, 120, 800, 340, 6, V(0, 0, 1.0)},
                                          {850, 190, 930, 240, 14, V(0, 0, 0)},
                                          {200, 185, 250, 215, 25, V(0, 0, 0)},
                                          {1000, 150, 1100, 260, 10, V(0, 0, -1)}});
  // Ragged boundaries and flow noise, as perception has them.
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.1F);
  for (int y = 0; y < camera.height; ++y) {
    const auto shift = static_cast<int>(random() % 5);
    std::rotate(p.panoptic.map.row(y), p.panoptic.map.row(y) + shift,
                p.panoptic.map.row(y) + camera.width);
    for (int x = 0; x < camera.width; ++x) {
      p.flow->u.at(x, y) += noise(random);
      p.flow->v.at(x, y) += noise(random);
    }
  }
  p.panoptic.runs = find_runs(p.panoptic.map);
  return p;
}

FramePriors make_priors(const StereoCamera& camera, const CameraPerception& p) {
  FramePriors priors;
  priors.label_space = "coco_panoptic_133";
  priors.has_motion = true;
  priors.cameras.push_back(fuse_camera({}, camera, p).priors);
  priors.cameras.push_back(priors.cameras[0]);
  for (PriorSegment& s : priors.cameras[1].segments) s.instance += prior_format::kRightInstances;
  return priors;
}

void fusion_of_both_cameras(benchmark::State& state) {
  const StereoCamera camera = synthetic::kitti_camera();
  const CameraPerception p = make_frame(camera);
  FusionTimes t;
  for (auto _ : state) {
    for (int c = 0; c < 2; ++c) {
      const CameraFusion fusion = fuse_camera({}, camera, p);
      t += fusion.times;
    }
  }
  const auto n = static_cast<double>(state.iterations());
  state.counters["fit_ms"] = t.fit / n;
  state.counters["residual_ms"] = t.residual / n;
  state.counters["drift_ms"] = t.drift / n;
  state.counters["statistics_ms"] = t.statistics / n;
  state.counters["export_ms"] = t.decide_export / n;
}

void encoding(benchmark::State& state) {
  const StereoCamera camera = synthetic::kitti_camera();
  const FramePriors priors = make_priors(camera, make_frame(camera));
  std::size_t size = 0;
  for (auto _ : state) size = encode_priors(priors, "benchmark").size();
  state.counters["file_bytes"] = static_cast<double>(size);
}

void open_and_look_up(benchmark::State& state) {
  const StereoCamera camera = synthetic::kitti_camera();
  const auto bytes = encode_priors(make_priors(camera, make_frame(camera)), "benchmark");
  const auto path = std::filesystem::temp_directory_path() / "kys_priors_benchmark.kysp";
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  std::vector<Keypoint> keypoints(2000);
  std::mt19937 random(2);
  for (Keypoint& k : keypoints) {
    k.x = static_cast<float>(random() % 1241);
    k.y = static_cast<float>(random() % 376);
  }
  std::vector<kys::Prior> out(keypoints.size());
  for (auto _ : state) {
    const PriorFile file = PriorFile::open(path);
    file.lookup(CameraSide::kLeft, keypoints, out);
    file.lookup(CameraSide::kRight, keypoints, out);
    benchmark::DoNotOptimize(out.data());
  }
  std::filesystem::remove(path);
}

BENCHMARK(fusion_of_both_cameras)->Unit(benchmark::kMillisecond);
BENCHMARK(encoding)->Unit(benchmark::kMillisecond);
BENCHMARK(open_and_look_up)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kys_slam

BENCHMARK_MAIN();
