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
  int min_descriptor_matches = 20;  ///< fewer: another place
  int min_aligned = 12;             ///< inliers of the alignment
  std::size_t first_window = 2;     ///< neighbours whose landmarks are matched by descriptor
  std::size_t window = 10;          ///< neighbours whose landmarks are projected
  float wide_radius = 10;           ///< px at octave 0, search after the alignment
  float narrow_radius = 4;          ///< px, search after the first refinement
  float search_distance = 64;       ///< bits
  int min_inliers = 40;             ///< landmarks that fit the refined pose
  double min_share = 0.1;           ///< of the landmarks that should be in view
  double min_area = 0.45;           ///< of the image area in which landmarks should be in view
  int min_observers = 2;            ///< keyframes of the place that ...
  int min_observed = 10;            ///< ... each see this many of the landmarks that fit
  std::uint64_t seed = 1;           ///< of the samples of the alignment
};
/// For check_options().
void describe(kys::OptionList& list, PlaceVerificationOptions& options);

/// A frame recognised at a place of the map.
struct VerifiedPlace {
  KeyFrameId keyframe;                ///< the place
  Rigid3 T_c_w;                       ///< pose of the frame in the place's sub-map
  std::vector<LandmarkId> landmarks;  ///< per feature of the frame; invalid: none
  int inliers = 0;                    ///< valid ones among them
  int in_view = 0;                    ///< landmarks of the place that should be in view
  double area = 0;  ///< share of the image area with landmarks in view that has matches
};

/// Landmarks seen by a keyframe and its `neighbours` best covisible ones, by id.
std::vector<LandmarkId> landmarks_around(const Map& map, KeyFrameId keyframe,
                                         std::size_t neighbours);

/// Is the frame at this place of the map? Its features are matched to the place's landmarks by
/// descriptor, aligned over SE(3) by its stereo points, then the landmarks around are searched
/// where the alignment puts them and the pose is refined (ORB-SLAM, Sec. VII-B, ORB-SLAM3, Sec.
/// VI-B). Accepted when enough landmarks fit, in number, as a share of what should be in view and
/// of the image area they should cover (a vehicle ahead looks the same in every place), and when
/// several keyframes of the place see them.
std::optional<VerifiedPlace> verify_place(const Map& map, const FrameFeatures& features,
                                          KeyFrameId place, const PlaceVerificationOptions& options,
                                          const kys::DistanceModel& model,
                                          kys::Statistics& statistics);

/// Does a frame with about this pose see the landmarks? Searches them within `radius` px and
/// refines the pose over what it finds. `keyframe` of the result is not set.
VerifiedPlace match_place(const Map& map, const FrameFeatures& features, const Rigid3& T_c_w,
                          const std::vector<LandmarkId>& around, float radius, float max_distance,
                          const kys::DistanceModel& model, kys::Statistics& statistics);

}  // namespace kys_slam
