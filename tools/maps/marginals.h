// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/problem.h>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "map_problem.h"

namespace kys_slam {

/// Normal equations of some residuals at the present place, landmarks eliminated (Triggs et al.,
/// "Bundle adjustment: a modern synthesis", Sec. 6.1).
struct NormalEquations {
  Eigen::SparseMatrix<double> H;  ///< information of the increments of the blocks, in their order
  /// Per landmark, of its residuals by the blocks: what independent landmarks contribute.
  Eigen::SparseMatrix<double, Eigen::RowMajor> gradients;
  /// Per part of the images (MapProblem::Row), by the blocks: of the error that it shares.
  Eigen::SparseMatrix<double, Eigen::RowMajor> shared;
  double chi2 = 0;  ///< of the residuals, with the loss
  std::int64_t residuals = 0;
  std::int64_t unknowns = 0;  ///< of landmarks and blocks
};
/// Of what a map measured. \param blocks variable ones, beside the landmarks
NormalEquations reduce(ceres::Problem& problem, MapProblem& map,
                       const std::vector<double*>& blocks);
/// Information of other residuals, none of them on landmarks.
Eigen::SparseMatrix<double> information(ceres::Problem& problem,
                                        const std::vector<ceres::ResidualBlockId>& residuals,
                                        const std::vector<double*>& blocks);

/// Covariances of unknowns at the minimum of measured residuals and others, H^-1 M H^-1: M is the
/// scatter of the gradients of single landmarks, so that it does not count on the noise model,
/// neither on its size nor on the independence of what is measured of one landmark (White,
/// "Maximum likelihood estimation of misspecified models", Econometrica 1982, Sec. 3, in clusters).
/// To it comes what many landmarks share in each part of the images.
class Marginals {
 public:
  /// Of every unknown: what nothing determines has a variance of 1e6, not of zero.
  /// Above the rounding of information that observations give (1e8 at most).
  static constexpr double kLeastInformation = 1e-6;

  /// \param others information of priors and other measurements, taken as it is
  /// \throws InputError when the unknowns are not determined
  Marginals(const NormalEquations& measured, const Eigen::SparseMatrix<double>& others);
  /// Of these unknowns, by index.
  [[nodiscard]] Eigen::MatrixXd covariance(const std::vector<Eigen::Index>& unknowns) const;

 private:
  const NormalEquations& measured_;
  Eigen::SparseMatrix<double> others_;
  double few_ = 1;  // for the residuals that the unknowns have taken up
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver_;
};

/// Blocks of the poses that are not held and have a residual.
std::vector<double*> free_poses(const ceres::Problem& problem, MapProblem& map);

/// What one recording says about the rig, with its poses and landmarks eliminated.
struct RigInformation {
  RigCorrection::Covariance H;  ///< information of (shape, own), without the priors
  double chi2 = 0;              ///< of the residuals, with the loss
  std::int64_t freedom = 0;     ///< residuals less unknowns
};

/// At the present place. Ceres' own covariances need a factorisation of all recordings together and
/// give up when a landmark has no depth.
RigInformation rig_information(ceres::Problem& problem, MapProblem& map, double* shape);

}  // namespace kys_slam
