// SPDX-License-Identifier: BSD-3-Clause
#include "rig_costs.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {

namespace {

constexpr double kRowSigma = 0.25;  // px of the octave, as rows are measured

template <int Rows, int Cols>
using JacobianMap = Eigen::Map<Eigen::Matrix<double, Rows, Cols, Eigen::RowMajor>>;

bool is_own(int place) {
  return std::any_of(kOwnParameters.begin(), kOwnParameters.end(),
                     [&](RigParameter p) { return static_cast<int>(p) == place; });
}

}  // namespace

const std::array<int, kShapeSize>& shape_places() {
  static const std::array<int, kShapeSize> kPlaces = [] {
    std::array<int, kShapeSize> places{};
    int n = 0;
    for (int k = 0; k < RigCorrection::kSize; ++k) {
      if (!is_own(k)) places.at(static_cast<std::size_t>(n++)) = k;
    }
    return places;
  }();
  return kPlaces;
}

const std::array<int, kOwnSize>& own_places() {
  static const std::array<int, kOwnSize> kPlaces = [] {
    std::array<int, kOwnSize> places{};
    std::transform(kOwnParameters.begin(), kOwnParameters.end(), places.begin(),
                   [](RigParameter p) { return static_cast<int>(p); });
    return places;
  }();
  return kPlaces;
}

RigCorrection::Parameters join(const double* shape, const double* own) {
  RigCorrection::Parameters all;
  for (const int place : shape_places()) all[place] = *shape++;
  for (const int place : own_places()) all[place] = *own++;
  return all;
}

PoseBlock to_block(const Rigid3& T) {
  const Eigen::Vector4d& q = T.rotation.coeffs();
  const Eigen::Vector3d& t = T.translation;
  return {q[0], q[1], q[2], q[3], t[0], t[1], t[2]};
}

Rigid3 to_pose(const double* block) {
  return {Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)),
          Eigen::Map<const Eigen::Vector3d>(block + 4)};
}

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Rigid3 T = to_pose(x);
  const Eigen::Quaterniond turn = so3_exp(Eigen::Map<const Eigen::Vector3d>(delta));
  const PoseBlock moved = to_block(
      {turn * T.rotation, turn * T.translation + Eigen::Map<const Eigen::Vector3d>(delta + 3)});
  std::copy(moved.begin(), moved.end(), x_plus_delta);
  return true;
}

bool PoseManifold::PlusJacobian(const double* /*x*/, double* jacobian) const {
  JacobianMap<kPoseSize, kPoseSize - 1> J(jacobian);
  J.setIdentity();
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Rigid3 T = to_pose(y) * to_pose(x).inverse();
  Eigen::Map<Eigen::Matrix<double, 6, 1>> delta(y_minus_x);
  delta << so3_log(T.rotation), T.translation;
  return true;
}

bool PoseManifold::MinusJacobian(const double* /*x*/, double* jacobian) const {
  JacobianMap<kPoseSize - 1, kPoseSize> J(jacobian);
  J.setIdentity();
  return true;
}

Eigen::Vector4d inverse_deviations(const MapObservations& map,
                                   const MapObservations::Observation& o) {
  const double u = o.inv_sigma;
  return {u, u * std::sqrt(map.information_v), u * std::sqrt(map.information_disparity),
          1 / (kRowSigma * o.scale)};
}

Eigen::Vector4d measured_values(const RigCorrection::Measured& m) {
  const double u = m.u, v = m.v;
  return {u, v, u - m.u_right, m.v_right - v};
}

template <int kRows>
MeasuredCost<kRows>::MeasuredCost(const StereoCamera* given,
                                  const RigCorrection::Measured& measured,
                                  const Eigen::Vector4d& inv_sigma)
    : given_(given), measured_(measured_values(measured)), inv_sigma_(inv_sigma) {}

template <int kRows>
bool MeasuredCost<kRows>::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  const Rigid3 T_c_w = to_pose(parameters[0]);
  const Eigen::Vector3d p_c = T_c_w * Eigen::Map<const Eigen::Vector3d>(parameters[1]);
  const RigCorrection rig(*given_, join(parameters[2], parameters[3]));
  const Prediction p = predict(*given_, rig, p_c, jacobians != nullptr);
  const Eigen::Matrix<double, kRows, 1> weight = inv_sigma_.head<kRows>();
  Eigen::Map<Eigen::Matrix<double, kRows, 1>> residual(residuals);
  residual = weight.cwiseProduct((p.value - measured_).template head<kRows>());
  if (!residual.allFinite()) return false;
  if (jacobians == nullptr) return true;
  const Eigen::Matrix<double, kRows, 3> J = weight.asDiagonal() * p.by_point.topRows<kRows>();
  if (jacobians[0] != nullptr) {
    JacobianMap<kRows, kPoseSize> by_pose(jacobians[0]);
    by_pose.template leftCols<3>() = -J * hat(p_c);
    by_pose.template middleCols<3>(3) = J;
    by_pose.col(kPoseSize - 1).setZero();
  }
  if (jacobians[1] != nullptr) JacobianMap<kRows, 3>{jacobians[1]} = J * T_c_w.R();
  const Eigen::Matrix<double, kRows, RigCorrection::kSize> by_rig =
      weight.asDiagonal() * p.by_rig.topRows<kRows>();
  const auto pick = [&](auto by, const auto& places) {
    for (std::size_t k = 0; k < places.size(); ++k) {
      by.col(static_cast<Eigen::Index>(k)) = by_rig.col(places[k]);
    }
  };
  if (jacobians[2] != nullptr) pick(JacobianMap<kRows, kShapeSize>{jacobians[2]}, shape_places());
  if (jacobians[3] != nullptr) pick(JacobianMap<kRows, kOwnSize>{jacobians[3]}, own_places());
  return true;
}

template class MeasuredCost<2>;
template class MeasuredCost<3>;
template class MeasuredCost<4>;

}  // namespace kys_slam
