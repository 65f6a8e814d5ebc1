// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/memory.h>

#include <algorithm>
#include <utility>

#include "optimization/block_cholesky.h"
#include "optimization/bundle_reduction.h"
#include "util/page_array.h"

namespace kys_slam {
namespace {

using namespace schur;

/// Pairs of free poses with an expected motion, the later one first, in order.
std::vector<std::pair<std::int32_t, std::int32_t>> moving_pairs(const BundlePoints& points) {
  const std::vector<std::int32_t>& free_index = points.free_index();
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  for (const MotionTerm& motion : points.problem().motions) {
    const std::int32_t a = free_index[motion.a];
    const std::int32_t b = free_index[motion.b];
    if (a >= 0 && b >= 0) pairs.emplace_back(std::max(a, b), std::min(a, b));
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

/// Blocks of poses that see a point together or have an expected motion.
BlockPattern needed_blocks(const BundlePoints& bundle) {
  const std::vector<BundlePoints::Point>& points = bundle.points();
  const std::size_t poses = bundle.free_poses().size();
  std::vector<std::int32_t> free_of;      // per observation, by point
  std::vector<std::int32_t> first_of{0};  // per point: the first of its observations
  free_of.reserve(bundle.problem().observations.size());
  first_of.reserve(points.size() + 1);
  for (const BundlePoints::Point& p : points) {
    bundle.for_each_observation(p, [&](const BundleProblem::Observation& o) {
      free_of.push_back(bundle.free_index()[o.pose]);
    });
    first_of.push_back(static_cast<std::int32_t>(free_of.size()));
  }
  // Observations by free pose, so that a row is finished before the next.
  std::vector<std::int32_t> begin(poses + 1, 0);
  for (const std::int32_t r : free_of) {
    if (r >= 0) ++begin[r + 1];
  }
  for (std::size_t r = 1; r < begin.size(); ++r) begin[r] += begin[r - 1];
  std::vector<std::int32_t> point_of(static_cast<std::size_t>(begin.back()));
  std::vector<std::int32_t> next(begin.begin(), begin.end() - 1);
  for (std::size_t k = 0; k < points.size(); ++k) {
    for (std::int32_t i = first_of[k]; i < first_of[k + 1]; ++i) {
      const std::int32_t r = free_of[i];
      if (r >= 0) point_of[next[r]++] = static_cast<std::int32_t>(k);
    }
  }
  BlockPattern pattern;
  std::vector<std::int32_t> seen_by(poses, -1);
  const auto pairs = moving_pairs(bundle);
  auto pair = pairs.begin();
  for (std::int32_t r = 0; r < static_cast<std::int32_t>(poses); ++r) {
    for (std::int32_t k = begin[r]; k < begin[r + 1]; ++k) {
      const std::int32_t point = point_of[k];
      for (std::int32_t i = first_of[point]; i < first_of[point + 1]; ++i) {
        const std::int32_t c = free_of[i];
        if (c > r) break;
        if (c < 0 || seen_by[c] == r) continue;
        seen_by[c] = r;
        pattern.column.push_back(c);
      }
    }
    for (; pair != pairs.end() && pair->first == r; ++pair) {
      if (std::exchange(seen_by[pair->second], r) != r) pattern.column.push_back(pair->second);
    }
    std::sort(pattern.column.begin() + pattern.row_begin.back(), pattern.column.end());
    pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
  }
  return pattern;
}

class SparseReduction final : public BundleReduction {
 public:
  explicit SparseReduction(const BundlePoints& points)
      : BundleReduction(points),
        pattern_(needed_blocks(points)),
        cholesky_(pattern_),
        use_order_(cholesky_.use_order()),
        memory_(pattern_.column.size()),
        other_memory_(points.points().size()),
        packed_(points.most_groups()) {
    places_ = BlockPlaces(pattern_, use_order_);
    blocks_ = {memory_.data(), memory_.size()};
    other_points_ = {other_memory_.data(), other_memory_.size()};
    return_freed_memory();  // that of the analysis of the pattern
  }

  /// What one stage needs takes the memory of what the others needed.
  void begin_step() override { other_memory_.release(0, other_memory_.size()); }
  /// Packed every time: kept, they were a fifth of the memory of an adjustment.
  const ObservationLanes* groups_of(std::size_t index) override {
    points_.pack(points_.points()[index], packed_.data());
    return packed_.data();
  }
  void keep(std::size_t /*index*/, const EliminatedPoint& /*point*/) override {}
  [[nodiscard]] const EliminatedPoint* kept(std::size_t /*index*/) const override {
    return nullptr;
  }
  Result solve(Eigen::VectorXd& x, const std::atomic<bool>* stop) override {
    const BlockCholesky::Result result = cholesky_.factorise(memory_, stop);
    if (result == BlockCholesky::Result::kStopped) return Result::kStopped;
    if (result != BlockCholesky::Result::kDone) return Result::kNoFactor;
    cholesky_.solve(x);
    cholesky_.release_factor();
    return Result::kDone;
  }
  [[nodiscard]] bool iterates_points() const override { return true; }

 private:
  BlockPattern pattern_;
  BlockCholesky cholesky_;
  std::vector<std::int32_t> use_order_;  // of the blocks
  PageArray<Matrix6d> memory_;
  PageArray<Eigen::Vector3d> other_memory_;
  std::vector<ObservationLanes> packed_;  // of one point
};

}  // namespace

std::unique_ptr<BundleReduction> sparse_reduction(const BundlePoints& points) {
  return std::make_unique<SparseReduction>(points);
}

}  // namespace kys_slam
