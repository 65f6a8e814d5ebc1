// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>

#include <cmath>
#include <string>
#include <utility>

#include "map_file/map_file.h"
#include "mapping/observations_of_map.h"
#include "mapping/rig_view.h"

namespace kys_slam {

MapObservations observations_of_map(const Map& map, const MapSelection& selection,
                                    const std::string& name) {
  RigView view = rig_view(map, newest_keyframes(map, selection.keyframes), selection.min_observers,
                          selection.observations, selection.coarsest_disparity);
  RigProblem& problem = view.problem;
  if (problem.points.empty()) {
    throw InputError(name + ": holds no landmark that " + std::to_string(selection.min_observers) +
                     " keyframes observe");
  }
  MapObservations result;
  result.camera = problem.camera;
  result.rig = map.rig_estimate();
  result.information_v = problem.information_v;
  result.information_disparity = problem.information_disparity;
  result.T_c_w = std::move(problem.T_c_w);
  result.held = std::move(problem.pose_fixed);
  result.landmarks = std::move(problem.points);
  result.first = std::move(problem.first);
  result.observations.reserve(problem.observations.size());
  for (const RigProblem::Observation& o : problem.observations) {
    RigCorrection::Measured measured = o.measured;
    if (!o.row) measured.v_right = std::nanf("");
    result.observations.push_back({measured, o.pose, o.scale, o.inv_sigma});
  }
  for (const KeyFrameId id : view.poses) {
    const KeyFrame& keyframe = map.keyframe(id);
    result.keyframe_ids.push_back(id.value);
    result.submaps.push_back(keyframe.submap.value);
    result.timestamps.push_back(keyframe.timestamp);
  }
  for (const LandmarkId id : view.landmarks) result.landmark_ids.push_back(id.value);
  return result;
}

MapObservations read_map_observations(const std::filesystem::path& file,
                                      const MapSelection& selection) {
  return observations_of_map(load_map_of_any_labels(file), selection, file.string());
}

}  // namespace kys_slam
