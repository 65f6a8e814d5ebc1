// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/bundle_points.h"

#include <algorithm>
#include <utility>

namespace kys_slam {

BundlePoints::BundlePoints(const BundleProblem& problem, const BundleRound& round)
    : problem_(problem), active_(round.active) {
  number_free_poses(round);
  find_observations();
}

void BundlePoints::number_free_poses(const BundleRound& round) {
  std::vector<std::uint8_t> used(problem_.T_c_w.size(), 0);
  for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
    if (round.active[i] != 0) used[problem_.observations[i].pose] = 1;
  }
  free_index_.assign(problem_.T_c_w.size() + 1, -1);
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i] == 0 || round.pose_fixed[i] != 0) continue;
    free_index_[i] = static_cast<std::int32_t>(free_pose_.size());
    free_pose_.push_back(static_cast<std::int32_t>(i));
  }
}

void BundlePoints::find_observations() {
  points_.reserve(problem_.points.size());
  for (std::size_t k = 0; k < problem_.points.size(); ++k) {
    const auto begin = active_.begin() + problem_.first[k];
    const auto end = active_.begin() + problem_.first[k + 1];
    const auto count = static_cast<std::int32_t>(end - begin - std::count(begin, end, 0));
    if (count > 0) points_.push_back({static_cast<std::int32_t>(k), count});
  }
  if (!is_ordered()) sort_observations();
  std::int32_t most = 0;
  for (const Point& point : points_) most = std::max(most, point.groups());
  most_groups_ = static_cast<std::size_t>(most);
}

/// Whether the active observations of every point are in order of free pose already: those of
/// whole maps are, and need no list of their order.
bool BundlePoints::is_ordered() const {
  for (const Point& point : points_) {
    std::int32_t last = -1;
    bool ordered = true;
    for_each_observation(point, [&](const BundleProblem::Observation& o) {
      ordered = ordered && free_index_[o.pose] >= last;
      last = free_index_[o.pose];
    });
    if (!ordered) return false;
  }
  return true;
}

void BundlePoints::sort_observations() {
  std::vector<std::int32_t> order(active_.size());
  const auto free_of = [&](std::int32_t i) { return free_index_[problem_.observations[i].pose]; };
  const auto earlier = [&](std::int32_t a, std::int32_t b) { return free_of(a) < free_of(b); };
  for (const Point& point : points_) {
    const auto begin = order.begin() + problem_.first[point.point];
    auto end = begin;
    for (std::int32_t i = problem_.first[point.point]; end - begin < point.count; ++i) {
      if (active_[i] != 0) *end++ = i;
    }
    if (!std::is_sorted(begin, end, earlier)) std::stable_sort(begin, end, earlier);
  }
  order_ = std::move(order);
}

void BundlePoints::pack(const Point& point, schur::ObservationLanes* to) const {
  schur::ObservationLanes none;
  none.pose.fill(static_cast<std::int32_t>(problem_.T_c_w.size()));
  std::fill_n(to, point.groups(), none);
  std::int32_t k = 0;
  for_each_observation(point, [&](const BundleProblem::Observation& o) {
    pack(o, k % kLanes, to[k / kLanes]);
    ++k;
  });
}

void BundlePoints::pack(const BundleProblem::Observation& o, int lane,
                        schur::ObservationLanes& to) const {
  to.u[lane] = o.u;
  to.v[lane] = o.v;
  to.u_right[lane] = o.u_right;
  to.inv_sigma[lane] = problem_.inv_sigma[o.noise];
  to.pose[lane] = static_cast<std::int32_t>(o.pose);
}

}  // namespace kys_slam
