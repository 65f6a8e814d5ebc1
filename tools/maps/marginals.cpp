// SPDX-License-Identifier: BSD-3-Clause
#include "marginals.h"

#include <ceres/crs_matrix.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>

namespace kys_slam {

namespace {

using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;
constexpr double kPointDamping = 1e-6;
constexpr double kPoseDamping = 1e-6;

/// Multiplies every row triple of a landmark by its factor: what is left of the other unknowns
/// after the landmark, Z = L^-1 J_point^T J, L L^T = J_point^T J_point.
Sparse eliminate_points(const Sparse& J_points, const Sparse& J_others) {
  const Sparse V = Sparse(J_points.transpose()) * J_points;
  const Sparse W = Sparse(J_points.transpose()) * J_others;
  std::vector<Eigen::Triplet<double>> factors;
  for (int p = 0; p < V.rows(); p += 3) {
    Eigen::Matrix3d block = Eigen::Matrix3d::Zero();
    for (int r = 0; r < 3; ++r) {
      for (Sparse::InnerIterator it(V, p + r); it; ++it) {
        if (it.col() >= p && it.col() < p + 3) block(r, it.col() - p) = it.value();
      }
    }
    block.diagonal().array() += kPointDamping;
    const Eigen::Matrix3d L_inverse = block.llt().matrixL().solve(Eigen::Matrix3d::Identity());
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c <= r; ++c) factors.emplace_back(p + r, p + c, L_inverse(r, c));
    }
  }
  Sparse inverse(V.rows(), V.rows());
  inverse.setFromTriplets(factors.begin(), factors.end());
  return inverse * W;
}

}  // namespace

RigInformation rig_information(ceres::Problem& problem,
                               const std::vector<ceres::ResidualBlockId>& residuals,
                               std::vector<Eigen::Vector3d>& landmarks,
                               std::vector<PoseBlock>& poses, double* shape, double* own) {
  const bool shape_held = problem.IsParameterBlockConstant(shape);
  const bool own_held = problem.IsParameterBlockConstant(own);
  if (shape_held) problem.SetParameterBlockVariable(shape);
  if (own_held) problem.SetParameterBlockVariable(own);
  ceres::Problem::EvaluateOptions options;
  options.residual_blocks = residuals;
  options.num_threads = 1;
  for (Eigen::Vector3d& p : landmarks) {
    if (problem.HasParameterBlock(p.data())) options.parameter_blocks.push_back(p.data());
  }
  const auto points = static_cast<int>(3 * options.parameter_blocks.size());
  int unknowns = points;
  for (PoseBlock& pose : poses) {
    if (!problem.HasParameterBlock(pose.data())) continue;
    if (problem.IsParameterBlockConstant(pose.data())) continue;
    options.parameter_blocks.push_back(pose.data());
    unknowns += kPoseSize - 1;
  }
  options.parameter_blocks.push_back(shape);
  options.parameter_blocks.push_back(own);
  RigInformation result;
  double cost = 0;
  ceres::CRSMatrix crs;
  problem.Evaluate(options, &cost, nullptr, nullptr, &crs);
  if (shape_held) problem.SetParameterBlockConstant(shape);
  if (own_held) problem.SetParameterBlockConstant(own);

  const Sparse J = Eigen::Map<const Sparse>(crs.num_rows, crs.num_cols,
                                            static_cast<Eigen::Index>(crs.values.size()),
                                            crs.rows.data(), crs.cols.data(), crs.values.data());
  const int others = crs.num_cols - points;
  const Eigen::SparseMatrix<double> by_column = J;
  const Sparse J_points = by_column.leftCols(points);
  const Sparse J_others = by_column.rightCols(others);
  const Sparse Z = eliminate_points(J_points, J_others);
  Eigen::MatrixXd H = Eigen::MatrixXd(Sparse(J_others.transpose()) * J_others);
  H -= Eigen::MatrixXd(Sparse(Z.transpose()) * Z);
  const int pose_unknowns = others - RigCorrection::kSize;
  Eigen::MatrixXd H_poses = H.topLeftCorner(pose_unknowns, pose_unknowns);
  H_poses.diagonal().array() += kPoseDamping;
  const Eigen::MatrixXd mixed = H.topRightCorner(pose_unknowns, RigCorrection::kSize);
  result.H = H.bottomRightCorner<RigCorrection::kSize, RigCorrection::kSize>() -
             mixed.transpose() * H_poses.llt().solve(mixed);
  result.chi2 = 2 * cost;
  result.freedom = crs.num_rows - unknowns;
  return result;
}

}  // namespace kys_slam
