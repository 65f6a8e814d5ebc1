// SPDX-License-Identifier: BSD-3-Clause
// Adjusts a map together with measured positions: refine_with_gps IN.map POSITIONS OUT.map
// Lines "time x y z  xx xy xz yy yz zz", s, m, m^2 (covariance): the map moves into their frame.
#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/saved_map.h>

#include <cstdio>
#include <fstream>
#include <map>

#include "position_cost.h"
#include "refinement.h"

using namespace kys_slam;

int main(int argc, char** argv) try {
  if (argc != 4) throw InputError("usage: refine_with_gps IN.map POSITIONS OUT.map");
  const std::string name = argv[2];
  std::map<double, Eigen::Matrix3d> covariance;  // by time, as the two others
  std::map<double, TimedPose> measured_at;
  std::ifstream file(name);
  for (TimedPose at; file >> at.timestamp; measured_at[at.timestamp] = at) {
    for (double& x : at.T_w_c.translation) file >> x;
    Eigen::Matrix3d& C = covariance[at.timestamp];
    for (int k : {0, 3, 6, 4, 7, 8}) file >> C.data()[k];
    C = Eigen::Matrix3d(C.selfadjointView<Eigen::Upper>());
    if (!file || C.llt().info() != Eigen::Success) throw InputError(name + ": bad line");
  }
  if (!file.eof()) throw InputError(name + ": no numbers");
  SavedMap saved(argv[1]);
  MapObservations map = saved.observations();
  std::map<double, std::size_t> keyframe_at;
  for (std::size_t k = 0; k < map.T_c_w.size(); ++k) keyframe_at[map.timestamps[k]] = k;
  std::vector<TimedPose> measured, path;
  for (const auto& [time, at] : measured_at) measured.push_back(at);
  for (const auto& [time, k] : keyframe_at) path.push_back({time, map.T_c_w[k].inverse()});
  const TrajectoryPair pair = associate_by_time(measured, path);
  const Similarity aligned = align(pair, Alignment::kSe3);
  if (pair.size() < 3 || aligned.degenerate) throw InputError(name + ": too few, or on a line");
  for (Rigid3& T : map.T_c_w) T = T * aligned.T.inverse();
  for (Eigen::Vector3d& point : map.landmarks) point = aligned.T * point;
  std::fill(map.held.begin(), map.held.end(), 0);  // the positions say where the map is
  RefinementOptions options;
  options.prior = RigEstimate({map.camera, RigCorrection::Parameters::Zero()}, rig_prior());
  options.more = [&](ceres::Problem& problem, MapProblem& blocks) {
    for (std::size_t i = 0; i < pair.size(); ++i) {
      const TimedPose& at = pair.reference[i];
      problem.AddResidualBlock(new PositionCost(at.T_w_c.t(), covariance[at.timestamp]), nullptr,
                               blocks.pose(keyframe_at[pair.estimate[i].timestamp]));
    }
  };
  const RefinementResult result = refine(map, options);
  saved.update(map);
  saved.write(argv[3]);
  std::printf("%zu positions, %d iterations\n", pair.size(), result.iterations);
} catch (const InputError& error) {
  return std::fprintf(stderr, "refine_with_gps: %s\n", error.what()), 2;
}
