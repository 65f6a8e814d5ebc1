// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/map_observations.h>

#include <cmath>
#include <string>
#include <utility>

#include "map_file/map_file.h"
#include "mapping/rig_view.h"

namespace kys_slam {

MapObservations read_map_observations(const std::filesystem::path& file,
                                      const MapSelection& selection) {
  const Map map = load_map_of_any_labels(file);
  RigProblem problem = rig_view(map, newest_keyframes(map, selection.keyframes),
                                selection.min_observers, selection.observations)
                           .problem;
  if (problem.points.empty()) {
    throw InputError(file.string() + ": holds no landmark that " +
                     std::to_string(selection.min_observers) + " keyframes observe");
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
  return result;
}

}  // namespace kys_slam
