// SPDX-License-Identifier: BSD-3-Clause
#include "rig_costs.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {

namespace {

constexpr double kRowSigma = 0.25;  // px of the octave, as rows are measured

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
  set_view_jacobians<kRows>(J, T_c_w, p_c, jacobians);
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
