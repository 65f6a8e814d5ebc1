// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>

#include "optimization/bundle_reduction.h"

namespace kys_slam {
namespace {

using namespace schur;

template <typename T>
using AlignedVector = std::vector<T, Eigen::aligned_allocator<T>>;

BlockPattern all_blocks(std::int32_t poses) {
  BlockPattern pattern;
  for (std::int32_t r = 0; r < poses; ++r) {
    for (std::int32_t c = 0; c <= r; ++c) pattern.column.push_back(c);
    pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
  }
  return pattern;
}

class DenseReduction final : public BundleReduction {
 public:
  explicit DenseReduction(const BundlePoints& points)
      : BundleReduction(points),
        poses_(static_cast<std::int32_t>(points.free_poses().size())),
        pattern_(all_blocks(poses_)),
        memory_(pattern_.column.size()),
        other_memory_(points.points().size()),
        eliminated_(points.points().size()),
        matrix_(6 * poses_, 6 * poses_) {
    places_ = BlockPlaces(pattern_);
    blocks_ = memory_;
    other_points_ = other_memory_;
    pack_all();
  }

  void begin_step() override {}
  const ObservationLanes* groups_of(std::size_t index) override {
    return groups_.data() + first_group_[index];
  }
  void keep(std::size_t index, const EliminatedPoint& point) override {
    eliminated_[index] = point;
  }
  [[nodiscard]] const EliminatedPoint* kept(std::size_t index) const override {
    return &eliminated_[index];
  }
  Result solve(Eigen::VectorXd& x, const std::atomic<bool>* /*stop*/) override {
    for (std::int32_t r = 0; r < poses_; ++r) {
      for (std::int32_t c = 0; c <= r; ++c) matrix_.block<6, 6>(6 * r, 6 * c) = block(r, c);
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(matrix_);
    if (factor.info() != Eigen::Success) return Result::kNoFactor;
    factor.solveInPlace(x);
    return Result::kDone;
  }
  [[nodiscard]] bool iterates_points() const override { return false; }

 private:
  void pack_all() {
    const std::vector<BundlePoints::Point>& points = points_.points();
    std::int32_t all = 0;
    for (const BundlePoints::Point& point : points) {
      first_group_.push_back(all);
      all += point.groups();
    }
    groups_.resize(static_cast<std::size_t>(all));
    for (std::size_t k = 0; k < points.size(); ++k) {
      points_.pack(points[k], groups_.data() + first_group_[k]);
    }
  }

  std::int32_t poses_;
  BlockPattern pattern_;
  AlignedVector<Matrix6d> memory_;
  std::vector<Eigen::Vector3d> other_memory_;
  std::vector<EliminatedPoint> eliminated_;
  std::vector<std::int32_t> first_group_;  // per point
  std::vector<ObservationLanes> groups_;
  Eigen::MatrixXd matrix_;
};

}  // namespace

std::unique_ptr<BundleReduction> dense_reduction(const BundlePoints& points) {
  return std::make_unique<DenseReduction>(points);
}

}  // namespace kys_slam
