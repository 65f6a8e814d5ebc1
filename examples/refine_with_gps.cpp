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
  std::vector<TimedPose> measured;
  std::map<double, Eigen::Matrix3d> covariance;  // by time
  std::ifstream file(argv[2]);
  for (TimedPose at; file >> at.timestamp;) {
    for (double& x : at.T_w_c.translation) file >> x;
    Eigen::Matrix3d& C = covariance[at.timestamp];
    for (int k : {0, 3, 6, 4, 7, 8}) file >> C.data()[k];
    C = Eigen::Matrix3d(C.selfadjointView<Eigen::Upper>());
    if (!file || C.llt().info() != Eigen::Success) throw InputError("bad line in POSITIONS");
    measured.push_back(at);
  }
  if (!file.eof()) throw InputError("POSITIONS: no numbers");
  SavedMap saved(argv[1]);
  MapObservations map = saved.observations();
  std::vector<TimedPose> path;
  for (std::size_t k = 0; k < map.T_c_w.size(); ++k) {
    path.push_back({map.timestamps[k], map.T_c_w[k].inverse()});
  }
  const TrajectoryPair pair = associate_by_time(measured, path);
  if (pair.size() < 3) throw InputError(std::string(argv[2]) + ": measures too few keyframes");
  const Rigid3 T_gps_map = align(pair, Alignment::kSe3).T;
  for (Rigid3& T : map.T_c_w) T = T * T_gps_map.inverse();
  for (Eigen::Vector3d& point : map.landmarks) point = T_gps_map * point;
  std::fill(map.held.begin(), map.held.end(), 0);  // the positions say where the map is
  RefinementOptions options;
  options.prior = RigEstimate({map.camera, RigCorrection::Parameters::Zero()}, rig_prior());
  options.more = [&](ceres::Problem& problem, MapProblem& blocks) {
    for (std::size_t i = 0, k = 0; i < pair.size(); ++i) {
      while (map.timestamps[k] != pair.estimate[i].timestamp) ++k;
      const TimedPose& at = pair.reference[i];
      auto* cost = new PositionCost(at.T_w_c.t(), covariance[at.timestamp]);
      problem.AddResidualBlock(cost, nullptr, blocks.pose(k));
    }
  };
  const RefinementResult result = refine(map, options);
  saved.update(map);
  saved.write(argv[3]);
  std::printf("%zu positions, %d iterations\n", pair.size(), result.iterations);
} catch (const InputError& error) {
  return std::fprintf(stderr, "refine_with_gps: %s\n", error.what()), 2;
}
