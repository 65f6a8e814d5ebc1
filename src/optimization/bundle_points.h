// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "optimization/bundle_solver.h"
#include "optimization/schur_kernels.h"

namespace kys_slam {

/// What of a problem takes part in a round: numbers of the free poses that are observed, points
/// with active observations, and these observations in order of free pose, so that sums run in the
/// same order however the caller listed them.
class BundlePoints {
 public:
  /// A point with active observations, and their number.
  struct Point {
    std::int32_t point;
    std::int32_t count;

    [[nodiscard]] std::int32_t groups() const { return (count + kLanes - 1) / kLanes; }
  };

  /// \param problem must outlive it, as must the flags of the round
  BundlePoints(const BundleProblem& problem, const BundleRound& round);

  [[nodiscard]] const BundleProblem& problem() const { return problem_; }
  /// Per pose, and one more: its number among the free ones, or -1.
  [[nodiscard]] const std::vector<std::int32_t>& free_index() const { return free_index_; }
  /// The other way.
  [[nodiscard]] const std::vector<std::int32_t>& free_poses() const { return free_pose_; }
  [[nodiscard]] const std::vector<Point>& points() const { return points_; }
  /// Most groups of a point.
  [[nodiscard]] std::size_t most_groups() const { return most_groups_; }

  /// Calls f(observation) for those of a point, in order.
  template <typename F>
  void for_each_observation(const Point& point, F&& f) const {
    std::int32_t i = problem_.first[point.point];
    if (!order_.empty()) {
      for (std::int32_t k = 0; k < point.count; ++k) f(problem_.observations[order_[i + k]]);
      return;
    }
    for (std::int32_t k = 0; k < point.count; ++i) {
      if (active_[i] == 0) continue;
      f(problem_.observations[i]);
      ++k;
    }
  }

  /// The observations of a point, into its groups.
  void pack(const Point& point, schur::ObservationLanes* to) const;

 private:
  void number_free_poses(const BundleRound& round);
  void find_observations();
  [[nodiscard]] bool is_ordered() const;
  void sort_observations();
  void pack(const BundleProblem::Observation& o, int lane, schur::ObservationLanes& to) const;

  const BundleProblem& problem_;
  std::span<const std::uint8_t> active_;  // per observation
  std::vector<std::int32_t> free_index_;
  std::vector<std::int32_t> free_pose_;
  std::vector<Point> points_;
  std::vector<std::int32_t> order_;  // of the active ones of each point from its first place on;
                                     // empty: they are in order
  std::size_t most_groups_ = 0;
};

}  // namespace kys_slam
