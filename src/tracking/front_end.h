// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/masks.h>
#include <kys_slam/prior_provider.h>
#include <kys_slam/rig_rows.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "features/pair_extractor.h"
#include "map/frame_features.h"
#include "matching/stereo_matcher.h"
#include "tracking/camera_faults.h"
#include "util/worker.h"

namespace kys_slam {

/// ms of the steps of the front end.
struct FrontEndTimes {
  double extract = 0;
  double priors = 0;
  double stereo = 0;
};

/// Rows of stereo matches show whether the pair is rectified.
struct RowOptions {
  bool enabled = true;
  double min_field = 0.1;  ///< px; what differs by less is taken for rectified
  int frames = 40;         ///< whose rows are measured, when they differ
};
/// For check_options().
void describe(kys::OptionList& list, RowOptions& options);

struct FrontEndResult {
  std::shared_ptr<const FrameFeatures> features;
  const ImagePyramid* left = nullptr;  ///< until the next frame; null: features without images
  FrontEndTimes times;
  kys::Statistics statistics;  ///< of stereo matching
  int stereo_matches = 0;
  std::vector<kys::Prior> segments;  ///< of the left image, with or without keypoints
  double prior_coverage = 0;         ///< share of keypoints with a valid label, 0..1
  std::string fault;                 ///< fault of one camera (CameraFaults); "": none
  bool repeated = false;             ///< the left image repeats that of the frame before
  int masked = 0;  ///< keypoints dropped: masked, or their segment moves (mode `mask`)
};

/// Computes the features of a stereo frame with disparities and priors: extraction of both images
/// in parallel, prior look-up, stereo matching.
class FrontEnd {
 public:
  /// \param model must outlive the front end, as must `priors` (null: none)
  FrontEnd(const StereoCamera& camera, std::unique_ptr<FeatureExtractor> extractor,
           const StereoOptions& stereo, const RowOptions& rows, const kys::DistanceModel& model,
           PriorProvider* priors);

  FrontEndResult process(const StereoFrame& frame, const StereoMasks& masks = {});
  /// Adds `by` to the instance numbers of things in later frames; a loaded map uses the numbers
  /// below.
  /// \param is_thing by label
  void raise_instances(std::int32_t by, std::vector<std::uint8_t> is_thing) {
    instances_raised_by_ = by;
    is_thing_ = std::move(is_thing);
  }
  /// Correction of what later frames measure; the map's, once there is one.
  void set_rig(const RigCorrection& rig) { rig_ = rig; }
  /// Begins with a correction and what it is worth, in place of none.
  void start_rig(const RigEstimate& rig) {
    rig_ = rig.correction;
    prior_ = rig.covariance;
  }
  /// From now on there is a map: rows do not change the correction any more.
  void hold_rig() { has_map_ = true; }
  /// A result made before that gets it too.
  void renew(FrontEndResult& result) const;
  /// What the rows of the first frames said; nothing yet, or nothing at all without images.
  [[nodiscard]] const std::optional<RowFit>& rows() const { return row_fit_; }

 private:
  bool attach_priors(const StereoFrame& frame, FrontEndResult& result);
  [[nodiscard]] StereoView view(std::size_t side, bool from_images) const;
  RightPositions match(bool from_images, kys::Statistics& statistics);
  [[nodiscard]] bool judge_rows(const RightPositions& right);

  StereoCamera camera_;
  ScaleLevels scales_;
  StereoOptions stereo_;
  RowOptions rows_;
  RigCorrection rig_;
  RigCorrection::Covariance prior_ = rig_prior();
  bool has_map_ = false;  // rig_ is the map's
  int frames_ = 0;
  std::optional<RowFit> row_fit_;
  std::int32_t instances_raised_by_ = 0;
  std::vector<std::uint8_t> is_thing_;  // by label
  const kys::DistanceModel* model_;
  PriorProvider* prior_provider_;
  PairExtractor extractor_;
  std::array<FeatureSet, 2> features_;
  std::array<std::vector<kys::Prior>, 2> priors_;
  CameraFaults camera_faults_;
  Worker helper_;  // matches half of the keypoints
};

}  // namespace kys_slam
