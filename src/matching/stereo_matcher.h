// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/features.h>
#include <kys_slam/stereo_camera.h>

#include <span>
#include <vector>

#include "features/orb_extractor.h"
#include "map/frame_features.h"
#include "util/worker.h"

namespace kys_slam {

struct StereoOptions {
  float max_distance = 75;  ///< bits, largest modulated distance accepted
  float row_tolerance = 2;  ///< px at the octave of the right keypoint
  bool refine = true;       ///< sub-pixel disparity by correlation of image patches
  /// matches with a patch residual above this times the median are dropped
  float median_cut = 2.1f;
  /// keypoints with disparity per instance flagged as moving; mode `verified` only
  int moving_keypoints = 300;
  float added_disparity = 0;  ///< px, an artificial error to test the regression suite
};
/// For check_options().
void describe(kys::OptionList& list, StereoOptions& options);

/// One side of a rectified pair.
struct StereoView {
  const FeatureSet* features = nullptr;
  std::span<const kys::Prior> priors;     ///< one per keypoint, or empty
  const ImagePyramid* pyramid = nullptr;  ///< null: no refinement (features without images)
};

/// Column of every left keypoint in the right image (ORB-SLAM2, Sec. III-A): candidates in the same
/// row band and neighbouring octaves, least modulated distance, sub-pixel alignment of an 11x11 px
/// patch (patch_alignment.h), and rejection of poor alignments.
/// \param rig correction of what is measured: rows and disparities of the perfect pair are compared
/// \param helper a thread that does half of the work, or null; the result is the same
/// \return px of the right image as it is, NaN where there is no match; rows without images only,
/// those of the right keypoints (with images: row_alignment.h)
RightPositions match_stereo(const StereoCamera& camera, const ScaleLevels& scales,
                            const StereoView& left, const StereoView& right,
                            const StereoOptions& options, const kys::DistanceModel& model,
                            kys::Statistics& statistics, Worker* helper = nullptr,
                            const RigCorrection& rig = {});

}  // namespace kys_slam
