// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/masks.h>
#include <kys_slam/prior_provider.h>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "features/orb_extractor.h"
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
  FrontEnd(const StereoCamera& camera, const OrbOptions& orb, const StereoOptions& stereo,
           const kys::DistanceModel& model, PriorProvider* priors);

  FrontEndResult process(const StereoFrame& frame, const StereoMasks& masks = {});
  /// Adds `by` to the instance numbers of things in later frames; a loaded map uses the numbers
  /// below.
  /// \param is_thing by label
  void raise_instances(std::int32_t by, std::vector<std::uint8_t> is_thing) {
    instances_raised_by_ = by;
    is_thing_ = std::move(is_thing);
  }
  /// px, added to the disparities of later frames.
  void set_disparity_offset(float offset) { disparity_offset_ = offset; }
  /// A result made before that gets the offset too.
  void renew(FrontEndResult& result) const;

 private:
  void extract(const StereoFrame& frame);
  bool attach_priors(const StereoFrame& frame, FrontEndResult& result);

  StereoCamera camera_;
  ScaleLevels scales_;
  StereoOptions stereo_;
  float disparity_offset_ = 0;
  std::int32_t instances_raised_by_ = 0;
  std::vector<std::uint8_t> is_thing_;  // by label
  const kys::DistanceModel* model_;
  PriorProvider* prior_provider_;
  std::array<OrbExtractor, 2> extractors_;  // left, right
  std::array<FeatureSet, 2> features_;
  std::array<std::vector<kys::Prior>, 2> priors_;
  CameraFaults camera_faults_;
  Worker helper_;  // extracts the right image, matches half of the keypoints
};

}  // namespace kys_slam
