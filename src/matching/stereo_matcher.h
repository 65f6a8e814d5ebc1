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
  float max_distance = 75;     ///< bits, largest modulated distance accepted
  float row_tolerance = 2;     ///< px at the octave of the right keypoint
  bool refine = true;          ///< sub-pixel disparity by correlation of image patches
  float median_cut = 2.1f;     ///< matches of a patch residual over this times the median go
  int moving_keypoints = 300;  ///< with disparity, per thing that its prior file calls moving; mode
                               ///< verified only
  float added_disparity = 0;   ///< px, a deliberate fault for testing the regression suite
};
/// For check_options().
void describe(kys::OptionList& list, StereoOptions& options);

/// One side of a rectified pair.
struct StereoView {
  const FeatureSet* features = nullptr;
  std::span<const kys::Prior> priors;     ///< one per keypoint, or empty
  const ImagePyramid* pyramid = nullptr;  ///< null: no refinement (features without images)
};

/// Column of every left keypoint in the right image (ORB-SLAM2, Sec. III-A): candidates on the same
/// row band and neighbouring octaves, nearest modulated descriptor, an 11x11 patch slid along the
/// row and aligned to a fraction of a pixel (patch_alignment.h), and a cut of poor alignments.
/// \param helper a thread that does half of it, or null; the result is the same
/// \return px, NaN where there is no match.
std::vector<float> match_stereo(const StereoCamera& camera, const ScaleLevels& scales,
                                const StereoView& left, const StereoView& right,
                                const StereoOptions& options, const kys::DistanceModel& model,
                                kys::Statistics& statistics, Worker* helper = nullptr);

}  // namespace kys_slam
