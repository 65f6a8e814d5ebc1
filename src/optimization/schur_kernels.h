// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "optimization/block_cholesky.h"
#include "optimization/reprojection_lanes.h"

/// The inner loops of bundle_schur.cpp: one point with its observations, four at a time, compiled
/// once per instruction set, with the same bytes.
namespace kys_slam::schur {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;

/// Four observations of one point; lanes past its end weigh nothing. Whole maps have very many, so
/// they are kept as the floats they come from.
struct ObservationLanes {
  using Floats = std::array<float, kLanes>;
  Floats u{}, v{}, u_right{};  // px; NaN where there is no u_right
  Floats inv_sigma{};          // 1/px
  std::array<std::int32_t, kLanes> pose{};
};

/// [R|t], row by row.
struct PoseMatrix {
  alignas(32) std::array<double, 12> rows;
};

/// Where the blocks of the lower triangle of the reduced system are: all of them, or those of poses
/// that share a point. A view of the pattern: with a table of all pairs of poses between the first
/// and the last of each row, long runs with loops needed memory by the square of their keyframes.
class BlockPlaces {
 public:
  BlockPlaces() = default;
  /// \param place of every block of the pattern; empty: in the pattern's order. Both must outlive
  /// it.
  explicit BlockPlaces(const BlockPattern& pattern, const std::vector<std::int32_t>& place = {})
      : begin_(pattern.row_begin.data()),
        column_(pattern.column.data()),
        place_(place.empty() ? nullptr : place.data()) {}

  /// The block must be one of the pattern's.
  [[nodiscard]] std::int32_t operator()(std::int32_t row, std::int32_t col) const {
    const std::int32_t* const first = column_ + begin_[row];
    const std::int32_t* const end = column_ + begin_[row + 1];
    const bool has_gaps = end - first != row - *first + 1;
    const std::int32_t* const at =
        has_gaps ? std::lower_bound(first, end, col) : first + (col - *first);
    return place_ == nullptr ? static_cast<std::int32_t>(at - column_) : place_[at - column_];
  }

 private:
  const std::int32_t* begin_ = nullptr;
  const std::int32_t* column_ = nullptr;
  const std::int32_t* place_ = nullptr;
};

/// What every point is looked at with. Of the poses, one more than there are: lanes past the end of
/// a point have that.
struct View {
  CameraNumbers camera;
  const PoseMatrix* poses;
  const std::int32_t* free;  // per pose: its place among the free ones, or -1
  bool robust;
  double ratio_v, ratio_disparity;  // information over that of u
  double chi2_mono, chi2_stereo;
};

/// A point that is looked at.
struct PointView {
  const double* p_w;
  double share;  // factor on the information of its observations
};

/// J^T W J (lower triangle, row by row) and J^T W r over a point.
struct PointNormal {
  double V[6];
  double b[3];
};

/// Of a pose: its gradient (6 numbers and 2 that are not used), then the diagonal of its block
/// before points are eliminated (the same).
struct PoseSums {
  alignas(32) std::array<double, 16> numbers{};

  [[nodiscard]] double* data() { return numbers.data(); }
  [[nodiscard]] Eigen::Map<Vector6d> gradient() { return Eigen::Map<Vector6d>(numbers.data()); }
  [[nodiscard]] Eigen::Map<Vector6d> diagonal() { return Eigen::Map<Vector6d>(numbers.data() + 8); }
};

/// Step of a pose: turn, 0, shift, 0.
struct PoseStep {
  alignas(32) std::array<double, 8> numbers{};

  [[nodiscard]] const double* data() const { return numbers.data(); }
};

/// Where the parts of the reduced system lie.
struct ReducedSystem {
  Matrix6d* blocks;
  const BlockPlaces* places;
  PoseSums* sums;
};

/// Of four observations: the blocks of their poses, their mixed blocks (pose rows, point columns,
/// column by column), their gradients.
struct MixedLanes {
  Lanes pose[36];
  Lanes block[18];
  Lanes gradient[6];
};

/// 1/2 the sum of rho over a point's observations.
double cost_of(const ObservationLanes* groups, std::int32_t count, const View& view,
               const PointView& point);

/// The normal equations of a point, the poses held.
void point_normal_of(const ObservationLanes* groups, std::int32_t count, const View& view,
                     const PointView& point, PointNormal& normal);

/// Linearises a point's observations and sums up the point's own part.
/// \param free per lane, the place of its pose among the free ones, or -1
void linearise(const ObservationLanes* groups, const std::int32_t* free, std::int32_t count,
               const View& view, const PointView& point, MixedLanes* mixed, PointNormal& normal);

/// Adds a linearised point's observations to the reduced system and takes the point out of it:
/// Z = mixed L^-T of each of them.
/// \param free as of linearise
/// \param L_inverse 00, 10, 11, 20, 21, 22
void eliminate(const std::int32_t* free, std::int32_t count, const MixedLanes* mixed,
               const double* L_inverse, const double* y, Matrix63* Z, const ReducedSystem& system);

/// Sum of the mixed blocks' transposes times the steps of the poses: what these steps mean for a
/// point's gradient. Made anew rather than kept from the linearisation: the mixed blocks of a whole
/// map are the largest thing there would be to keep.
void moved_gradient(const ObservationLanes* groups, std::int32_t count, const View& view,
                    const PointView& point, const PoseStep* steps, double* gradient);

/// Places of four poses among the free ones.
KYS_ALWAYS_INLINE void look_up_free(const ObservationLanes& o, const View& view,
                                    std::int32_t* free) {
  for (int k = 0; k < kLanes; ++k) free[k] = view.free[o.pose[k]];
}

}  // namespace kys_slam::schur
