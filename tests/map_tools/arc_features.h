// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_file.h>

#include <cmath>
#include <filesystem>

#include "simulator/features/feature_world.h"

namespace kys_slam::testing {

/// Writes a feature file of a camera on an arc of 60 m radius, 10 Hz, 0.6 m per frame.
inline void write_arc(const std::filesystem::path& file, const StereoCamera& camera, int frames,
                      simulator::FeatureOptions options) {
  simulator::FeaturePath path;
  path.camera = camera;
  path.ground = 1.65;
  for (int i = 0; i < frames; ++i) {
    const double a = 0.01 * i;
    const Rigid3 T(Eigen::Quaterniond(Eigen::AngleAxisd(a, Eigen::Vector3d::UnitY())),
                   Eigen::Vector3d(60 * (1 - std::cos(a)), 0, 60 * std::sin(a)));
    path.poses.push_back({100 + 0.1 * i, T});
  }
  options.features = 800;
  const simulator::FeatureWorld world(path, options);
  FeatureSequenceWriter writer(file, world.info());
  for (int i = 0; i < frames; ++i) writer.write(world.frame(static_cast<std::size_t>(i)));
  writer.finish();
}

}  // namespace kys_slam::testing
