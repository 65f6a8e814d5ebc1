// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <memory>
#include <span>

#include "optimization/bundle_points.h"
#include "optimization/eliminated_point.h"

namespace kys_slam {

/// The reduced system of a bundle adjustment and the memory that goes with it. Windows keep what
/// they make of every point; whole maps make it again, because it is the largest thing they would
/// keep.
class BundleReduction {
 public:
  enum class Result : std::uint8_t { kDone, kNoFactor, kStopped };

  BundleReduction(const BundleReduction&) = delete;
  BundleReduction& operator=(const BundleReduction&) = delete;
  virtual ~BundleReduction() = default;

  /// A step begins: other_points() are not needed until it is solved.
  virtual void begin_step() = 0;
  /// The groups of a point, until those of another are asked for.
  virtual const schur::ObservationLanes* groups_of(std::size_t index) = 0;
  virtual void keep(std::size_t index, const EliminatedPoint& point) = 0;
  /// A point as it was eliminated; null where it is not kept.
  [[nodiscard]] virtual const EliminatedPoint* kept(std::size_t index) const = 0;
  /// \param x right side, then solution; six per free pose
  virtual Result solve(Eigen::VectorXd& x, const std::atomic<bool>* stop) = 0;
  /// Whether every step is followed by steps of the points one by one.
  [[nodiscard]] virtual bool iterates_points() const = 0;

  /// Blocks of the lower triangle, where places() says.
  [[nodiscard]] std::span<schur::Matrix6d> blocks() const { return blocks_; }
  [[nodiscard]] const schur::BlockPlaces& places() const { return places_; }
  [[nodiscard]] schur::Matrix6d& block(std::int32_t row, std::int32_t col) const {
    return blocks_[places_(row, col)];
  }
  /// Points after a step not taken yet, or before it.
  [[nodiscard]] std::span<Eigen::Vector3d> other_points() const { return other_points_; }

 protected:
  explicit BundleReduction(const BundlePoints& points) : points_(points) {}

  const BundlePoints& points_;
  schur::BlockPlaces places_;
  std::span<schur::Matrix6d> blocks_;
  std::span<Eigen::Vector3d> other_points_;
};

/// For windows of few poses. \param points must outlive it
std::unique_ptr<BundleReduction> dense_reduction(const BundlePoints& points);
/// For whole maps, by blocks. \param points the same
std::unique_ptr<BundleReduction> sparse_reduction(const BundlePoints& points);

}  // namespace kys_slam
