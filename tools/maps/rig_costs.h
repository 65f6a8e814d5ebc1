// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>
#include <kys_slam/map_observations.h>
#include <kys_slam/rigid3.h>

#include <array>

#include "pose_block.h"
#include "prediction.h"

namespace kys_slam {

/// What differs from recording to recording of one rig: it bends and turns a little with load and
/// temperature. The rest, the shape, stays.
inline constexpr std::array kOwnParameters = {RigParameter::kPitch, RigParameter::kRoll,
                                              RigParameter::kOffset, RigParameter::kRow};
inline constexpr int kOwnSize = static_cast<int>(kOwnParameters.size());
inline constexpr int kShapeSize = RigCorrection::kSize - kOwnSize;
using Shape = Eigen::Matrix<double, kShapeSize, 1>;
using Own = Eigen::Matrix<double, kOwnSize, 1>;

/// Places of the shape's parameters among all, and of a recording's own ones.
const std::array<int, kShapeSize>& shape_places();
const std::array<int, kOwnSize>& own_places();
RigCorrection::Parameters join(const double* shape, const double* own);

/// Predicted less measured (u, v), (u, v, disparity), or those and the row, over their deviations.
/// Both in px of the images as measured: predicted places, in which the derivatives are taken, have
/// no noise in them. Blocks: pose, p_w, shape, a recording's own parameters.
template <int kRows>
class MeasuredCost final
    : public ceres::SizedCostFunction<kRows, kPoseSize, 3, kShapeSize, kOwnSize> {
 public:
  MeasuredCost(const StereoCamera* given, const RigCorrection::Measured& measured,
               const Eigen::Vector4d& inv_sigma);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  const StereoCamera* given_;
  Eigen::Vector4d measured_;
  Eigen::Vector4d inv_sigma_;
};

/// 1/px of (u, v, disparity, row).
Eigen::Vector4d inverse_deviations(const MapObservations& map,
                                   const MapObservations::Observation& observation);
/// (u, v, disparity, row) as measured; NaN where there is none.
Eigen::Vector4d measured_values(const RigCorrection::Measured& measured);

}  // namespace kys_slam
