// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_residuals.h"

#include "geometry/reprojection.h"

namespace kys_slam {

namespace {

constexpr double kRowSigma = 0.25;  // px of the octave

}  // namespace

void RigResiduals::update() {
  corrected_.clear();
  corrected_.reserve(p_->observations.size());
  for (const RigProblem::Observation& o : p_->observations) corrected_.push_back(correct(o));
}

RigResidual RigResiduals::at(std::size_t observation, const Eigen::Vector3d& p_w) const {
  const RigProblem::Observation& o = p_->observations[observation];
  const Corrected& c = corrected_[observation];
  RigResidual r;
  r.p_c = p_->T_c_w[o.pose] * p_w;
  const double unit = static_cast<double>(o.inv_sigma) * o.inv_sigma;
  r.information.head<2>() << unit, unit * p_->information_v;
  if (!std::isnan(o.measured.u_right)) {
    r.information[2] = unit * p_->information_disparity;
    if (o.row) {
      r.e[3] = c.row;
      r.information[3] = 1 / (kRowSigma * kRowSigma * o.scale * o.scale);
    }
  }
  r.scale = c.scale;
  r.e.head<3>() = r.scale.cwiseProduct(
      reprojection_error(p_->camera, r.p_c, c.pixel.x(), c.pixel.y(), c.pixel.z()));
  return r;
}

RigCorrection::Jacobian RigResiduals::jacobian(std::size_t observation,
                                               const RigResidual& r) const {
  RigCorrection::Measured expected = p_->observations[observation].measured;
  expected.u += static_cast<float>(r.e[0]);
  expected.v += static_cast<float>(r.e[1]);
  expected.u_right += static_cast<float>(r.e[0] - r.e[2]);
  expected.v_right += static_cast<float>(r.e[1] - r.e[3]);
  RigCorrection::Jacobian J = p_->rig.jacobian(expected);
  for (int row = 0; row < 3; ++row) J.row(row) *= -r.scale[row];
  // Not numbers where there is no column.
  if (!r.has_disparity()) J.row(2).setZero();
  if (!r.has_row()) J.row(3).setZero();
  return J;
}

RigResiduals::Corrected RigResiduals::correct(const RigProblem::Observation& o) const {
  Corrected c;
  const RigCorrection::Measured& m = o.measured;
  if (std::isnan(m.u_right)) {
    c.pixel.head<2>() = p_->rig.left(m.u, m.v);
  } else {
    const RigCorrection::Ideal ideal = p_->rig.pair(m);
    c.pixel << ideal.u, ideal.v, ideal.u_right;
    c.row = ideal.row;
  }
  const Eigen::Vector2d stretch = p_->rig.stretch(m.u, m.v);
  c.scale << 1 / stretch.x(), 1 / stretch.y(), 1 / (stretch.x() * p_->rig.focal_scale());
  return c;
}

}  // namespace kys_slam
