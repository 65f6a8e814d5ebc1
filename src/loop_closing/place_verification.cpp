// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/place_verification.h"

#include <algorithm>
#include <map>

#include "geometry/image_cells.h"
#include "geometry/stereo_alignment.h"
#include "map/seen_landmarks.h"
#include "matching/descriptor_matcher.h"
#include "matching/landmark_search.h"
#include "matching/predicted_view.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {

void describe(kys::OptionList& list, PlaceVerificationOptions& o) {
  list.add("place.descriptor_distance", o.descriptor_distance, {1, 1e6}, "bits",
           "largest distance of a match without prediction");
  list.add("place.descriptor_ratio", o.descriptor_ratio, {0.1, 10}, "",
           "largest best over second best distance of a match without prediction");
  list.add("place.min_descriptor_matches", o.min_descriptor_matches, {3, 60000}, "",
           "matches without prediction below which the place is rejected");
  list.add("place.min_aligned", o.min_aligned, {3, 60000}, "",
           "inliers of the alignment below which the place is rejected");
  list.add("place.wide_radius", o.wide_radius, {0.5, 1000}, "px",
           "search radius after the alignment, octave 0");
  list.add("place.narrow_radius", o.narrow_radius, {0.5, 1000}, "px",
           "search radius after the first refinement, octave 0");
  list.add("place.search_distance", o.search_distance, {1, 1e6}, "bits",
           "largest distance of a match with prediction");
  list.add("place.min_inliers", o.min_inliers, {3, 60000}, "",
           "inlier landmarks of the refined pose below which the place is rejected");
  list.add("place.min_share", o.min_share, {0, 1}, "",
           "least share of inliers in the landmarks predicted in view");
  list.add("place.min_area", o.min_area, {0, 1}, "",
           "least share of the image area with landmarks in view that has matches");
  list.add("place.min_observers", o.min_observers, {0, 1000}, "",
           "least number of keyframes of the place that observe place.min_observed inliers");
  list.add("place.min_observed", o.min_observed, {0, 60000}, "",
           "inliers that each of place.min_observers keyframes observes at least");
  list.add("place.seed", o.seed, {0, 1e9}, "", "seed of the random samples of the alignment");
  const kys::OptionList::Fixed fixed(list);
  list.add("place.first_window", o.first_window, {0, 1000});
  list.add("place.window", o.window, {0, 1000});
}

namespace {

/// Standard deviations are twice those of pixels alone: the map at the place has errors of its own,
/// and no bundle adjustment has aligned it with the frame yet.
constexpr float kSharpness = 0.5f;

StereoPixel pixel_of(const FrameFeatures& features, std::size_t i, const ScaleLevels& scales) {
  StereoPixel pixel = features.stereo_pixel(i, scales);
  pixel.inv_sigma *= kSharpness;
  return pixel;
}

/// A landmark of the place as one of its keyframes sees it.
struct SeenLandmark {
  LandmarkId landmark;
  KeyFrameId keyframe;
  std::size_t feature;
};

/// Landmarks of the place and its nearest neighbours, each with the first of these to see it.
std::vector<SeenLandmark> landmarks_seen(const Map& map, KeyFrameId place, std::size_t neighbours) {
  std::vector<KeyFrameId> keyframes{place};
  for (const KeyFrameId id : map.best_covisible(place, neighbours)) keyframes.push_back(id);
  std::vector<SeenLandmark> seen;
  std::vector<LandmarkId> known;
  for (const KeyFrameId id : keyframes) {
    const KeyFrame& keyframe = map.keyframe(id);
    const std::size_t before = known.size();
    for (std::size_t f = 0; f < keyframe.landmarks.size(); ++f) {
      const LandmarkId landmark = keyframe.landmarks[f];
      const auto end = known.begin() + static_cast<std::ptrdiff_t>(before);
      if (!landmark.valid() || std::binary_search(known.begin(), end, landmark)) continue;
      seen.push_back({landmark, id, f});
      known.push_back(landmark);
    }
    std::sort(known.begin(), known.end());
  }
  return seen;
}

/// Pose of the frame from matches by descriptor alone.
std::optional<Rigid3> align(const Map& map, const FrameFeatures& features, KeyFrameId place,
                            const PlaceVerificationOptions& options,
                            const kys::DistanceModel& model, kys::Statistics& statistics) {
  const std::vector<SeenLandmark> seen = landmarks_seen(map, place, options.first_window);
  std::vector<DescriptorQuery> queries;
  queries.reserve(seen.size());
  for (const SeenLandmark& s : seen) {
    const Landmark& landmark = map.landmark(s.landmark);
    queries.push_back({&landmark.descriptor, &landmark.prior,
                       map.keyframe(s.keyframe).features->keypoint(s.feature).angle});
  }
  const DescriptorMatchOptions matching{options.descriptor_distance, options.descriptor_ratio,
                                        true};
  const std::vector<std::int32_t> matched =
      match_descriptors(queries, features, matching, model, statistics);

  const Rigid3& T_p_w = map.keyframe(place).T_c_w;
  std::vector<PointMatch> matches;
  int count = 0;
  for (std::size_t q = 0; q < seen.size(); ++q) {
    if (matched[q] < 0) continue;
    ++count;
    const auto feature = static_cast<std::size_t>(matched[q]);
    if (!features.has_stereo(feature)) continue;
    const Keypoint& k = features.keypoint(feature);
    PointMatch match;
    match.p_a = map.camera().back_project(k.x, k.y, features.depth(feature));
    match.pixel_a = pixel_of(features, feature, map.scales());
    // The landmark where the place's own keyframe would see it, as sharp as its observer does.
    match.p_b = T_p_w * map.landmark(seen[q].landmark).p_w;
    if (match.p_b.z() <= 0) continue;
    const Eigen::Vector3d pixel = map.camera().project_stereo(match.p_b);
    const FrameFeatures& theirs = *map.keyframe(seen[q].keyframe).features;
    match.pixel_b = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y()),
                     static_cast<float>(pixel.z()),
                     kSharpness * map.scales().inv_sigma(theirs.keypoint(seen[q].feature).octave)};
    matches.push_back(match);
  }
  if (count < options.min_descriptor_matches) return std::nullopt;
  RansacOptions ransac;
  ransac.seed = options.seed;
  ransac.min_inliers = options.min_aligned;
  const RansacResult result = align_se3_ransac(map.camera(), matches, ransac);
  if (!result.success) return std::nullopt;
  return result.T * T_p_w;
}

/// Refines the pose over the frame's landmarks; outliers lose theirs. Returns the inliers.
int refine(const Map& map, const FrameFeatures& features, Rigid3& T_c_w,
           std::vector<LandmarkId>& landmarks) {
  std::vector<PoseObservation> observations;
  std::vector<std::size_t> at;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (!landmarks[i].valid()) continue;
    const StereoPixel p = pixel_of(features, i, map.scales());
    observations.push_back({map.landmark(landmarks[i]).p_w, p.u, p.v, p.u_right, p.inv_sigma});
    at.push_back(i);
  }
  const PoseResult result = optimize_pose(map.camera(), T_c_w, observations);
  T_c_w = result.T_c_w;
  for (std::size_t k = 0; k < at.size(); ++k) {
    if (result.outlier[k] != 0) landmarks[at[k]] = {};
  }
  return result.inliers;
}

/// Share of the cells in view that have a matched feature. Many inliers on one object in a corner,
/// as on a vehicle ahead that was there at the place too, cover little of the view.
double area_share(const FrameFeatures& features, const std::vector<LandmarkId>& landmarks,
                  const ImageCells& cells, const std::vector<std::uint8_t>& in_view) {
  std::vector<std::uint8_t> matched(cells.size(), 0);
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (landmarks[i].valid())
      matched[cells.index(features.keypoint(i).x, features.keypoint(i).y)] = 1;
  }
  const auto wanted = std::count(in_view.begin(), in_view.end(), 1);
  const auto seen = std::count(matched.begin(), matched.end(), 1);
  return wanted > 0 ? static_cast<double>(seen) / static_cast<double>(wanted) : 0;
}

/// Keyframes that see at least `min_observed` of the landmarks.
int observers(const Map& map, const std::vector<LandmarkId>& landmarks, int min_observed) {
  std::map<KeyFrameId, int> counts;
  for (const LandmarkId id : landmarks) {
    if (!id.valid()) continue;
    for (const Observation& o : map.landmark(id).observations) ++counts[o.keyframe];
  }
  return static_cast<int>(std::count_if(counts.begin(), counts.end(), [&](const auto& entry) {
    return entry.second >= min_observed;
  }));
}

}  // namespace

std::vector<LandmarkId> landmarks_around(const Map& map, KeyFrameId keyframe,
                                         std::size_t neighbours) {
  std::vector<KeyFrameId> keyframes = map.best_covisible(keyframe, neighbours);
  keyframes.push_back(keyframe);
  return landmarks_seen_by(map, keyframes);
}

VerifiedPlace match_place(const Map& map, const FrameFeatures& features, const Rigid3& T_c_w,
                          const std::vector<LandmarkId>& around, float radius, float max_distance,
                          const kys::DistanceModel& model, kys::Statistics& statistics) {
  const Eigen::Vector3d centre = T_c_w.inverse_t();
  const ImageCells cells(map.camera(), kAreaColumns);
  std::vector<std::uint8_t> in_view(cells.size(), 0);
  std::vector<SearchQuery> queries;
  std::vector<LandmarkId> queried;
  for (const LandmarkId id : around) {
    const Landmark& landmark = map.landmark(id);
    const auto view = predict_view(map.camera(), map.scales(), T_c_w, centre, landmark);
    if (!view) continue;
    queries.push_back(query_for(*view, radius, map.scales(), landmark.descriptor, landmark.prior));
    queried.push_back(id);
    in_view[cells.index(queries.back().u, queries.back().v)] = 1;
  }
  SearchOptions search;
  search.max_distance = max_distance;
  const std::vector<SearchMatch> matches =
      search_features(features, map.scales(), queries, search, model, statistics);
  VerifiedPlace found;
  found.T_c_w = T_c_w;
  found.in_view = static_cast<int>(queried.size());
  found.landmarks.resize(features.size());
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    found.landmarks[static_cast<std::size_t>(matches[q].feature)] = queried[q];
  }
  found.inliers = refine(map, features, found.T_c_w, found.landmarks);
  found.area = area_share(features, found.landmarks, cells, in_view);
  return found;
}

/// Each test answers a kind of false place. Few descriptor matches: a similar texture. Few aligned
/// ones: matches without a common geometry. A small share of what should be in view: a place
/// beside. A small area: a vehicle that stood at both places, which has as many inliers as a
/// facade. Few observing keyframes: landmarks that only one of them has seen. With the number of
/// inliers alone, a truck ahead verifies as a place (README; `place.min_area: 0` in
/// configs/baseline.yaml).
std::optional<VerifiedPlace> verify_place(const Map& map, const FrameFeatures& features,
                                          KeyFrameId place, const PlaceVerificationOptions& options,
                                          const kys::DistanceModel& model,
                                          kys::Statistics& statistics) {
  const std::optional<Rigid3> aligned = align(map, features, place, options, model, statistics);
  if (!aligned) return std::nullopt;
  const std::vector<LandmarkId> around = landmarks_around(map, place, options.window);
  VerifiedPlace found;
  found.T_c_w = *aligned;
  // The alignment rests on few matches and is some pixels off: the wide search corrects it, and the
  // narrow one drops matches with repeated texture beside the right place.
  for (const float radius : {options.wide_radius, options.narrow_radius}) {
    found = match_place(map, features, found.T_c_w, around, radius, options.search_distance, model,
                        statistics);
    if (found.inliers < options.min_inliers) return std::nullopt;
  }
  found.keyframe = place;
  if (found.inliers < options.min_share * found.in_view) return std::nullopt;
  if (found.area < options.min_area) return std::nullopt;
  const auto keyframes = static_cast<int>(1 + map.best_covisible(place, options.window).size());
  if (observers(map, found.landmarks, options.min_observed) <
      std::min(options.min_observers, keyframes)) {
    return std::nullopt;
  }
  return found;
}

}  // namespace kys_slam
