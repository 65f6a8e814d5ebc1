// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/scene_support.h"

#include <algorithm>

namespace kys_slam {

void describe(kys::OptionList& list, SceneSupportOptions& o) {
  list.add("tracking.fixed_in_view", o.in_view, {0, 60000}, "",
           "stereo points with which the scene that cannot move is in view (mode verified)");
  list.add("tracking.fixed_share", o.share, {0, 1}, "",
           "share of them that has to support a pose while it is in view");
  list.add("tracking.object_edge", o.edge, {0, 1000}, "px",
           "so near to a feature of an object one may show its edge and supports nothing");
  list.add("tracking.longest_unsupported", o.longest, {0, 60}, "s",
           "after the last support of the fixed scene in which objects alone may hold a pose");
}

/// Vehicles around the camera that move together fit a pose that moves with them, with more inliers
/// than the road between them gives. So the pose is tested by what cannot move. The bound is the
/// smaller of two: a share of what is in view, or as many as objects have, since where objects
/// support little there is nothing to outvote (README, rules of the judge).
bool SceneSupport::is_enough(const SceneSupportOptions& options) const {
  const double needed = std::min(static_cast<double>(on_objects), options.share * in_view);
  return inliers >= needed;
}

namespace {

/// Counts what is in view, and finds what stands on objects and inliers that do not.
SceneSupport look_at(const TrackingContext& c, const FrameFeatures& features,
                     const std::vector<LandmarkId>& landmarks, std::vector<std::uint8_t>& on_object,
                     std::vector<std::size_t>& fixed) {
  SceneSupport support;
  on_object.assign(features.size(), 0);
  for (std::size_t i = 0; i < features.size(); ++i) {
    const kys::Prior& prior = features.prior(i);
    const LandmarkView* landmark = c.replica.landmarks().find(landmarks[i]);
    const bool can_move = landmark != nullptr ? c.beliefs.can_move(prior, landmark->prior)
                                              : c.beliefs.can_move(prior);
    if (can_move) {
      on_object[i] = 1;
      if (landmark != nullptr) ++support.on_objects;
    } else if (landmark != nullptr || features.has_stereo(i)) {
      ++support.in_view;
      if (landmark != nullptr) fixed.push_back(i);
    }
  }
  return support;
}

}  // namespace

SceneSupport scene_in_view(const TrackingContext& c, const FrameFeatures& features,
                           const std::vector<LandmarkId>& landmarks) {
  std::vector<std::uint8_t> on_object;
  std::vector<std::size_t> fixed;
  return look_at(c, features, landmarks, on_object, fixed);
}

SceneSupport scene_support(const TrackingContext& c, const FrameFeatures& features,
                           const std::vector<LandmarkId>& landmarks) {
  std::vector<std::uint8_t> on_object;
  std::vector<std::size_t> fixed;  // inliers
  SceneSupport support = look_at(c, features, landmarks, on_object, fixed);
  if (!support.is_in_view(c.options.judge.support)) return support;
  const auto is_edge = [&](const Keypoint& k) {
    const float reach = c.options.judge.support.edge * c.scales.scale[k.octave];
    bool edge = false;
    features.for_each_near(k.x, k.y, reach, 0, c.scales.levels() - 1, [&](std::size_t i) {
      const float dx = features.keypoint(i).x - k.x, dy = features.keypoint(i).y - k.y;
      edge |= on_object[i] != 0 && dx * dx + dy * dy < reach * reach;
    });
    return edge;
  };
  support.inliers = static_cast<int>(
      std::ranges::count_if(fixed, [&](std::size_t i) { return !is_edge(features.keypoint(i)); }));
  return support;
}

}  // namespace kys_slam
