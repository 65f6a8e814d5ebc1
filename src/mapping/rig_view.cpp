// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/rig_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace kys_slam {

namespace {

// Factor on the information of disparities. That of aligned keypoints is as measured
// (kImageInformation). Corners as they are found repeat to about 0.26 px, disparities to 0.09 px of
// the octave. It matters here: the inverse distances that several views give are as uncertain as
// the corners, and taken for more accurate than they are they flatten the line through (inverse
// distance, disparity) and raise its intercept, which is the offset.
constexpr double kWeightAligned = 1;
constexpr double kWeightFound = 8;

/// Poses and landmarks of a rig problem, by index in its arrays.
class ViewMaker {
 public:
  ViewMaker(const Map& map, std::vector<KeyFrameId> keyframes, int min_observers,
            std::size_t most_observations, float coarsest)
      : map_(map), coarsest_(coarsest) {
    view.poses = std::move(keyframes);
    const std::vector<KeyFrameId>& poses = view.poses;
    RigProblem& problem = view.problem;
    for (std::size_t k = 0; k < poses.size(); ++k) index_.put(poses[k], k);
    problem.camera = map.camera();
    problem.rig = map.rig();
    for (const KeyFrameId id : poses) {
      problem.T_c_w.push_back(map.keyframe(id).T_c_w);
      problem.pose_fixed.push_back(0);
    }
    hold_submaps();
    std::vector<LandmarkId> chosen;
    std::size_t observations = 0;
    map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
      const auto seen = static_cast<std::size_t>(
          std::count_if(landmark.observations.begin(), landmark.observations.end(),
                        [&](const Observation& o) { return index_.contains(o.keyframe); }));
      if (static_cast<int>(seen) < min_observers) return;
      chosen.push_back(id);
      observations += seen;
    });
    const std::size_t every = (observations + most_observations - 1) / most_observations;
    for (std::size_t i = 0; i < chosen.size(); i += std::max<std::size_t>(1, every)) {
      view.landmarks.push_back(chosen[i]);
      add(map.landmarks().at(chosen[i]));
    }
    const bool aligned = 2 * aligned_ >= problem.observations.size();
    problem.information_disparity *= aligned ? kWeightAligned : kWeightFound;
  }

  RigView view;

 private:
  /// One keyframe of every sub-map stays.
  void hold_submaps() {
    const std::vector<KeyFrameId>& poses = view.poses;
    IdTable<KeyFrameId, std::uint8_t> held;
    for (std::size_t k = 0; k < poses.size(); ++k) {
      const KeyFrameId submap = map_.keyframe(poses[k]).submap;
      if (held.contains(submap)) continue;
      held.put(submap, 1);
      view.problem.pose_fixed[k] = 1;
    }
  }

  void add(const Landmark& landmark) {
    RigProblem& problem = view.problem;
    problem.points.push_back(landmark.p_w);
    problem.first.push_back(problem.first.back());
    for (const Observation& o : landmark.observations) {
      const std::size_t* pose = index_.find(o.keyframe);
      if (pose == nullptr) continue;
      const FrameFeatures& features = *map_.keyframe(o.keyframe).features;
      const StereoPixel pixel = features.stereo_pixel(o.feature, map_.scales());
      RigProblem::Observation seen;
      seen.pose = static_cast<std::uint32_t>(*pose);
      seen.scale = map_.scales().scale[features.keypoint(o.feature).octave];
      seen.inv_sigma = pixel.inv_sigma;
      seen.measured = features.measured(o.feature);
      if (std::isnan(pixel.u_right) || seen.scale > coarsest_) {
        seen.measured.u_right = std::nanf("");
      } else if (std::isnan(seen.measured.v_right)) {
        const Keypoint& k = features.keypoint(o.feature);
        seen.measured.v_right =
            static_cast<float>(map_.rig().measured_right(k.x, k.y, pixel.u_right).y());
      } else {
        seen.row = true;
      }
      problem.information_v = pixel.ratio.v;
      problem.information_disparity = pixel.ratio.disparity;
      problem.observations.push_back(seen);
      ++problem.first.back();
      aligned_ += features.is_aligned(o.feature) ? 1 : 0;
    }
  }

  const Map& map_;
  float coarsest_;
  IdTable<KeyFrameId, std::size_t> index_;
  std::size_t aligned_ = 0;
};

}  // namespace

void RigView::write_to(Map& map) const {
  for (std::size_t k = 0; k < poses.size(); ++k) {
    if (problem.pose_fixed[k] == 0) map.set_pose(poses[k], problem.T_c_w[k]);
  }
  for (std::size_t k = 0; k < landmarks.size(); ++k) {
    map.set_position(landmarks[k], problem.points[k]);
  }
}

RigView rig_view(const Map& map, std::vector<KeyFrameId> poses, int min_observers,
                 std::size_t most_observations, float coarsest) {
  return ViewMaker(map, std::move(poses), min_observers, most_observations, coarsest).view;
}

std::vector<KeyFrameId> newest_keyframes(const Map& map, std::size_t most) {
  std::vector<KeyFrameId> ids = map.keyframes().ids();
  if (ids.size() > most) ids.erase(ids.begin(), ids.end() - static_cast<std::ptrdiff_t>(most));
  return ids;
}

}  // namespace kys_slam
