// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <vector>

#include "optimization/rig_bundle.h"

namespace kys_slam {

/// Of one observation: u, v, disparity, row; px of the images as measured. In px of the perfect
/// pair residuals would be smaller the more the correction shrinks the images, which would bias it.
struct RigResidual {
  Eigen::Vector4d e = Eigen::Vector4d::Zero();
  Eigen::Vector3d scale = Eigen::Vector3d::Ones();  ///< measured over ideal
  Eigen::Vector4d information = Eigen::Vector4d::Zero();
  Eigen::Vector3d p_c = Eigen::Vector3d::Zero();

  [[nodiscard]] double chi2() const { return e.head<3>().cwiseAbs2().dot(information.head<3>()); }
  [[nodiscard]] double row_chi2() const { return e[3] * e[3] * information[3]; }
  [[nodiscard]] bool has_disparity() const { return information[2] > 0; }
  [[nodiscard]] bool has_row() const { return information[3] > 0; }
};

/// Residuals of a problem, with what its correction makes of every observation.
class RigResiduals {
 public:
  /// \param problem outlives this
  explicit RigResiduals(const RigProblem& problem) : p_(&problem) {}
  /// To be called when the correction has changed.
  void update();
  [[nodiscard]] RigResidual at(std::size_t observation, const Eigen::Vector3d& p_w) const;
  /// Row r: derivatives of e[r], less those by pose and point, by all parameters of the correction,
  /// where the point is expected: at the measured place noise would correlate with the slopes. Zero
  /// where nothing is measured.
  [[nodiscard]] RigCorrection::Jacobian jacobian(std::size_t observation,
                                                 const RigResidual& r) const;

 private:
  /// The same for all poses and points.
  struct Corrected {
    Eigen::Vector3d pixel = Eigen::Vector3d::Zero();  // u, v, u_right of the perfect pair, px
    double row = 0;                                   // px
    Eigen::Vector3d scale = Eigen::Vector3d::Ones();  // measured over ideal px of u, v, disparity
  };
  [[nodiscard]] Corrected correct(const RigProblem::Observation& o) const;

  const RigProblem* p_;
  std::vector<Corrected> corrected_;
};

}  // namespace kys_slam
