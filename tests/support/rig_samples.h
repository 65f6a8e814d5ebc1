// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>

#include <initializer_list>
#include <utility>

namespace kys_slam::testing {

/// f 700 px, centre (600, 180), 1241x376.
inline StereoCamera kitti_like() {
  return {1241, 376, 700, 700, 600, 180, 0.54};
}

inline RigCorrection rig_with(const StereoCamera& camera,
                              std::initializer_list<std::pair<RigParameter, double>> values) {
  RigCorrection::Parameters parameters = RigCorrection::Parameters::Zero();
  for (const auto& [parameter, value] : values) parameters[static_cast<int>(parameter)] = value;
  return {camera, parameters};
}

/// A rig with errors of every kind, of the size of KITTI's: rows differ by up to 1.5 px.
inline RigCorrection bent_rig(const StereoCamera& camera) {
  return rig_with(camera, {{RigParameter::kLeftK1, 0.011},
                           {RigParameter::kLeftK2, -0.002},
                           {RigParameter::kLeftP1, 0.0004},
                           {RigParameter::kLeftP2, -0.0003},
                           {RigParameter::kRightK1, 0.013},
                           {RigParameter::kRightK2, -0.001},
                           {RigParameter::kRightP1, 0.0002},
                           {RigParameter::kRightP2, -0.004},
                           {RigParameter::kYaw, -0.012},
                           {RigParameter::kPitch, 0.001},
                           {RigParameter::kRoll, 0.0005},
                           {RigParameter::kRatio, 0.001},
                           {RigParameter::kOffset, 0.3},
                           {RigParameter::kRow, 0.2},
                           {RigParameter::kBaselineY, 0.002},
                           {RigParameter::kBaselineZ, -0.003},
                           {RigParameter::kFocal, -0.004}});
}

}  // namespace kys_slam::testing
