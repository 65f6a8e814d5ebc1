// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <optional>
#include <span>

#include "map/frame_features.h"
#include "matching/landmark_search.h"

namespace kys_slam {

/// A keypoint of an instance of unknown motion.
struct UnknownPlace {
  std::size_t source = 0;    ///< keypoint of the earlier frame
  Eigen::Vector3d expected;  ///< m, in the camera now, if the instance is static
  SearchQuery query;  ///< around the projection of `expected`, as far as the instance can move
};

struct CommonShiftOptions {
  float max_distance;      ///< bits
  int min_count;           ///< least number of keypoints that agree
  double min_share = 0.3;  ///< least share of all keypoints that agree
  float tolerance = 3;     ///< px at the octave of the keypoint, in columns and row
  std::span<const std::uint8_t> taken = {};  ///< per keypoint now: not 0: no candidate; or empty
};
/// For check_options().
void describe(kys::OptionList& list, CommonShiftOptions& options);

/// The translation on which most keypoints of an instance agree. Each of the nearest candidates of
/// each keypoint proposes a translation; the one with most supporting keypoints is returned. On
/// repeated texture single matches are ambiguous, while their common translation is not. \return m,
/// in the axes of the camera now; nothing when too few agree
std::optional<Eigen::Vector3d> common_shift(const StereoCamera& camera, const ScaleLevels& scales,
                                            const FrameFeatures& features,
                                            std::span<const UnknownPlace> places,
                                            const CommonShiftOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics);

}  // namespace kys_slam
