// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "map/ids.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

/// Where a candidate for the pose of a frame comes from.
enum class PoseSource : std::uint8_t {
  kMotion,          ///< landmarks of the last frame, where constant velocity expects them
  kReference,       ///< landmarks of the reference keyframe by descriptor alone
  kMap,             ///< all landmarks around the last frame by descriptor alone
  kPoints,          ///< all stereo points of the last frame, where constant velocity expects them
  kRelocalisation,  ///< a place recognised in the whole map
};
const char* to_string(PoseSource source);

/// What speaks for a candidate, measured in the frame alone.
struct Evidence {
  int matches = 0;  ///< landmarks or points matched
  int inliers = 0;  ///< of these, those that fit the pose
  double position_sigma = std::numeric_limits<double>::infinity();  ///< m, least certain direction
  [[nodiscard]] double inlier_share() const { return inliers / static_cast<double>(matches); }
};

/// A pose that a frame may have.
struct PoseCandidate {
  PoseSource source = PoseSource::kMotion;
  Rigid3 T_c_w;
  std::vector<LandmarkId> matched;    ///< per feature, outliers included; invalid: none
  std::vector<LandmarkId> landmarks;  ///< the same without outliers
  std::optional<PosePrior> held;      ///< the expected pose, when it was used as a prior
  bool overruled = false;             ///< image area gave another pose than the number of matches
  Evidence evidence;
};

/// What a source of candidates returns.
struct Attempt {
  PoseCandidate candidate;  ///< its evidence is valid in any case
  std::string failure;      ///< why it is no candidate; "": it is one
  kys::Statistics statistics;

  [[nodiscard]] bool found() const { return failure.empty(); }
};

}  // namespace kys_slam
