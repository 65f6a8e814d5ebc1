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

/// A keypoint of a thing whose motion is not known.
struct UnknownPlace {
  std::size_t source = 0;    ///< keypoint of the earlier frame
  Eigen::Vector3d expected;  ///< m, in the camera now, if the thing stands still
  SearchQuery query;         ///< around the pixels of `expected`, as far as the thing can move
};

struct CommonShiftOptions {
  float max_distance;      ///< bits
  int min_count;           ///< keypoints that have to agree at least
  double min_share = 0.3;  ///< the same, of all
  float tolerance = 3;     ///< px at the octave of the keypoint, in columns and row
  std::span<const std::uint8_t> taken = {};  ///< per keypoint now: not 0: no candidate; or empty
};
/// For check_options().
void describe(kys::OptionList& list, CommonShiftOptions& options);

/// How far most keypoints of a thing went, as one translation: each of the nearest candidates of
/// each keypoint proposes one, and the one that most keypoints have a candidate for wins. Where a
/// thing repeats itself single matches are ambiguous; what they have in common is not.
/// \return m, in the axes of the camera now; nothing when too few agree
std::optional<Eigen::Vector3d> common_shift(const StereoCamera& camera, const ScaleLevels& scales,
                                            const FrameFeatures& features,
                                            std::span<const UnknownPlace> places,
                                            const CommonShiftOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics);

}  // namespace kys_slam
