// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_observations.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "calibration.h"
#include "simulator/common/rig_error.h"

namespace kys_slam::testing {

inline const StereoCamera kKitti{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};

/// Drives along winding streets, seen by a rig with an error.
struct SimulatedDrive {
  int keyframes = 30;
  int landmarks = 700;
  double noise = 1;  ///< times what residuals in maps of images are
  bool rows = true;
  /// px of disparity per px between the rows of a pair, mean of landmarks: images are compared in
  /// rows that do not correspond
  double slope = 0;
  unsigned seed = 1;
};

inline std::vector<Rigid3> winding_poses(int count) {
  std::vector<Rigid3> poses;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  for (int k = 0; k < count; ++k) {
    const double heading = 0.5 * std::sin(0.2 * k);
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitY()));
    const Rigid3 T_w_c(turn, position);
    poses.push_back(T_w_c.inverse());
    position += turn * Eigen::Vector3d(0, 0, 1.0);
  }
  return poses;
}

inline Recording simulate(const simulator::RigError& error, const SimulatedDrive& drive) {
  const simulator::TruePair pair(kKitti, error);
  std::mt19937_64 random(drive.seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  // Aligned keypoints: kys_slam's assumed deviations are a little more than these.
  constexpr double kU = 0.14, kV = 0.10, kDisparity = 0.09, kRow = 0.08;  // px
  Recording recording{"drive " + std::to_string(drive.seed), {}};
  MapObservations& map = recording.map;
  map.camera = kKitti;
  map.information_v = 2.5;
  map.information_disparity = 3;
  map.T_c_w = winding_poses(drive.keyframes);
  map.held.assign(map.T_c_w.size(), 0);
  map.held[0] = 1;
  while (static_cast<int>(map.landmarks.size()) < drive.landmarks) {
    const auto from = static_cast<std::size_t>(uniform(random) * drive.keyframes);
    const double depth = 4 * std::pow(20.0, uniform(random));
    const Eigen::Vector3d p_w =
        map.T_c_w[from].inverse() *
        kKitti.back_project(uniform(random) * kKitti.width, uniform(random) * kKitti.height, depth);
    const double slope = drive.slope > 0 ? 2 * drive.slope * uniform(random) : 0;
    std::vector<MapObservations::Observation> seen;
    for (std::size_t k = 0; k < map.T_c_w.size(); ++k) {
      const Eigen::Vector3d p_c = map.T_c_w[k] * p_w;
      if (p_c.z() < 3 || p_c.z() > 90) continue;
      const Eigen::Vector4d at = pair.observe(p_c);
      if (!kKitti.in_image(at[0], at[1]) || !kKitti.in_image(at[2], at[3])) continue;
      const double u = at[0] + drive.noise * kU * normal(random);
      const double v = at[1] + drive.noise * kV * normal(random);
      const double disparity =
          at[0] - at[2] + slope * (at[3] - at[1]) + drive.noise * kDisparity * normal(random);
      const double row = at[3] - at[1] + drive.noise * kRow * normal(random);
      RigCorrection::Measured measured{static_cast<float>(u), static_cast<float>(v),
                                       static_cast<float>(u - disparity)};
      if (drive.rows) measured.v_right = static_cast<float>(v + row);
      seen.push_back({measured, static_cast<std::uint32_t>(k), 1, 1 / 0.175f});
      if (seen.size() == 8) break;
    }
    if (seen.size() < 3) continue;
    map.landmarks.push_back(p_w);
    map.observations.insert(map.observations.end(), seen.begin(), seen.end());
    map.first.push_back(static_cast<std::int32_t>(map.observations.size()));
  }
  return recording;
}

}  // namespace kys_slam::testing
