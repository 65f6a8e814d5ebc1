// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/evaluation.h>

#include <algorithm>
#include <numbers>

namespace kys_slam {
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

Rigid3 step(const std::vector<TimedPose>& poses, std::size_t from, std::size_t to) {
  return poses[from].T_w_c.inverse() * poses[to].T_w_c;
}

/// Driven length from the first pose to every pose, m.
std::vector<double> driven(std::span<const TimedPose> poses) {
  std::vector<double> length(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    length[i] = length[i - 1] + (poses[i].T_w_c.t() - poses[i - 1].T_w_c.t()).norm();
  }
  return length;
}

}  // namespace

std::vector<double> absolute_errors(const TrajectoryPair& pair) {
  std::vector<double> errors;
  errors.reserve(pair.size());
  for (std::size_t i = 0; i < pair.size(); ++i) {
    errors.push_back((pair.reference[i].T_w_c.t() - pair.estimate[i].T_w_c.t()).norm());
  }
  return errors;
}

RelativeErrors relative_errors(const TrajectoryPair& pair, std::size_t delta, bool all_steps) {
  RelativeErrors errors;
  delta = std::max<std::size_t>(delta, 1);
  for (std::size_t i = 0; i < pair.size() && delta < pair.size() - i; i += all_steps ? 1 : delta) {
    const Rigid3 error =
        step(pair.reference, i, i + delta).inverse() * step(pair.estimate, i, i + delta);
    errors.translation.push_back(error.t().norm());
    errors.rotation.push_back(rotation_angle(error) * kDegrees);
  }
  return errors;
}

KittiErrors kitti_errors(const TrajectoryPair& pair) {
  constexpr std::size_t kStep = 10;
  const std::vector<double> length = driven(pair.reference);
  KittiErrors errors;
  for (std::size_t first = 0; first < pair.size(); first += kStep) {
    for (int segment = 100; segment <= 800; segment += 100) {
      const auto last = std::upper_bound(length.begin() + static_cast<std::ptrdiff_t>(first),
                                         length.end(), length[first] + segment);
      if (last == length.end()) break;  // longer ones do not fit either
      const auto to = static_cast<std::size_t>(last - length.begin());
      const Rigid3 error =
          step(pair.estimate, first, to).inverse() * step(pair.reference, first, to);
      errors.translation_percent += error.t().norm() / segment * 100.0;
      errors.rotation_deg_per_100m += rotation_angle(error) * kDegrees / segment * 100.0;
      ++errors.segments;
    }
  }
  if (errors.segments > 0) {
    errors.translation_percent /= static_cast<double>(errors.segments);
    errors.rotation_deg_per_100m /= static_cast<double>(errors.segments);
  }
  return errors;
}

double path_length(std::span<const TimedPose> poses) {
  return poses.empty() ? 0.0 : driven(poses).back();
}

}  // namespace kys_slam
