// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "map/map.h"

namespace kys_slam {

struct PlaceVerificationOptions {
  float descriptor_distance = 60;   ///< bits, matching without prediction
  float descriptor_ratio = 0.8f;    ///< best / second best
  int min_descriptor_matches = 20;  ///< with fewer, the place is rejected
  int min_aligned = 12;             ///< inliers of the alignment
  std::size_t first_window = 2;     ///< neighbours whose landmarks are matched by descriptor
  std::size_t window = 10;          ///< neighbours whose landmarks are projected
  float wide_radius = 10;           ///< px at octave 0, search after the alignment
  float narrow_radius = 4;          ///< px, search after the first refinement
  float search_distance = 64;       ///< bits
  int min_inliers = 40;             ///< landmarks that fit the refined pose
  double min_share = 0.1;           ///< inliers as a share of the landmarks predicted in view
  double min_area = 0.45;           ///< share of the image area with landmarks predicted in view
  int min_observers = 2;            ///< keyframes of the place that observe min_observed inliers
  int min_observed = 10;            ///< inlier landmarks that each of these keyframes observes
  std::uint64_t seed = 1;           ///< of the RANSAC samples of the alignment
};
/// For check_options().
void describe(kys::OptionList& list, PlaceVerificationOptions& options);

/// A frame recognised at a place (keyframe) of the map.
struct VerifiedPlace {
  KeyFrameId keyframe;                ///< the place
  Rigid3 T_c_w;                       ///< pose of the frame in the sub-map of the place
  std::vector<LandmarkId> landmarks;  ///< per feature of the frame; invalid: none
  int inliers = 0;                    ///< valid ones among them
  int in_view = 0;                    ///< landmarks of the place predicted in view
  double area = 0;  ///< share of the image area with landmarks in view that has matches
};

/// Landmarks observed by a keyframe and its `neighbours` best covisible keyframes, by id.
std::vector<LandmarkId> landmarks_around(const Map& map, KeyFrameId keyframe,
                                         std::size_t neighbours);

/// Tests whether the frame is at this place of the map (ORB-SLAM, Sec. VII-B; ORB-SLAM3, Sec.
/// VI-B). Its features are matched to the landmarks of the place by descriptor and aligned over
/// SE(3) by its stereo points. Then the landmarks around are searched at their projections and the
/// pose is refined. The place is accepted when enough landmarks are inliers: in number, as a share
/// of the landmarks predicted in view, and as a share of the image area these cover (a vehicle
/// ahead appears the same in every place). Several keyframes of the place must observe them.
std::optional<VerifiedPlace> verify_place(const Map& map, const FrameFeatures& features,
                                          KeyFrameId place, const PlaceVerificationOptions& options,
                                          const kys::DistanceModel& model,
                                          kys::Statistics& statistics);

/// Searches the landmarks `around` within `radius` px of their projections by T_c_w, an approximate
/// pose of the frame, and refines the pose over the matches. `keyframe` of the result is not set.
VerifiedPlace match_place(const Map& map, const FrameFeatures& features, const Rigid3& T_c_w,
                          const std::vector<LandmarkId>& around, float radius, float max_distance,
                          const kys::DistanceModel& model, kys::Statistics& statistics);

}  // namespace kys_slam
