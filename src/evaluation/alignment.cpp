// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/evaluation.h>

#include "geometry/absolute_orientation.h"

namespace kys_slam {
namespace {

// Of straight lines: a car's way that leaves the line by 1 mm in 1 km still determines the
// rotation.
constexpr double kMinSpread = 1e-12;

std::vector<Eigen::Vector3d> positions(const std::vector<TimedPose>& poses) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(poses.size());
  for (const TimedPose& pose : poses) result.push_back(pose.T_w_c.t());
  return result;
}

Eigen::Vector3d mean(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) sum += p;
  return sum / static_cast<double>(points.size());
}

}  // namespace

Similarity align(const TrajectoryPair& pair, Alignment alignment) {
  Similarity result;
  if (alignment == Alignment::kNone || pair.size() == 0) return result;
  const std::vector<Eigen::Vector3d> reference = positions(pair.reference);
  const std::vector<Eigen::Vector3d> estimate = positions(pair.estimate);
  const auto aligned =
      align_points(reference, estimate, {}, alignment == Alignment::kSim3, kMinSpread);
  if (aligned) {
    result.scale = aligned->scale;
    result.T = aligned->T;
    return result;
  }
  result.degenerate = true;
  const Rigid3 first(pair.reference[0].T_w_c.rotation * pair.estimate[0].T_w_c.rotation.conjugate(),
                     Eigen::Vector3d::Zero());
  result.T = Rigid3(first.rotation, mean(reference) - first * mean(estimate));
  return result;
}

void transform(std::vector<TimedPose>& poses, const Similarity& similarity) {
  for (TimedPose& pose : poses) {
    const Eigen::Vector3d scaled = similarity.scale * pose.T_w_c.t();
    pose.T_w_c = similarity.T * Rigid3(pose.T_w_c.rotation, scaled);
  }
}

}  // namespace kys_slam
