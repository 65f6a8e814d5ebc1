// SPDX-License-Identifier: BSD-3-Clause
#include "marginals.h"

#include <ceres/crs_matrix.h>
#include <kys_slam/error.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCore>
#include <algorithm>

namespace kys_slam {

namespace {

using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;
constexpr double kPointDamping = 1e-6;
constexpr double kPoseDamping = 1e-6;

/// L^-1 of every landmark, L L^T = J_point^T J_point.
Sparse inverse_factors(const Sparse& J_points) {
  const Sparse V = Sparse(J_points.transpose()) * J_points;
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
  return inverse;
}

/// Sums of rows, landmarks eliminated: `sums` (groups x rows) of J_others.
/// \param Z L^-1 J_point^T J_others
Sparse reduced_sums(const Sparse& sums, const Sparse& J_points, const Sparse& J_others,
                    const Sparse& factors, const Sparse& Z) {
  const Sparse by_point = Sparse(sums * J_points) * Sparse(factors.transpose());
  return Sparse(sums * J_others) - Sparse(by_point * Z);
}

/// Landmarks x rows: its residuals.
Sparse residuals_of_landmarks(const Sparse& J_points, const std::vector<double>& residuals) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < J_points.rows(); ++row) {
    const Sparse::InnerIterator first(J_points, row);
    if (!first) continue;
    entries.emplace_back(static_cast<int>(first.col()) / 3, row,
                         residuals[static_cast<std::size_t>(row)]);
  }
  Sparse sums(J_points.cols() / 3, J_points.rows());
  sums.setFromTriplets(entries.begin(), entries.end());
  return sums;
}

/// Parts x rows: what the errors that parts share make of residuals.
Sparse errors_of_parts(const std::vector<MapProblem::Row>& rows) {
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    entries.emplace_back(rows[row].part, static_cast<int>(row), rows[row].shared);
  }
  Sparse sums(MapProblem::kParts, static_cast<Eigen::Index>(rows.size()));
  sums.setFromTriplets(entries.begin(), entries.end());
  return sums;
}

struct Evaluated {
  Sparse J;
  std::vector<double> residuals;
  double cost = 0;
};
Evaluated evaluate_blocks(ceres::Problem& problem,
                          const std::vector<ceres::ResidualBlockId>& residuals,
                          const std::vector<double*>& blocks) {
  ceres::Problem::EvaluateOptions options;
  options.residual_blocks = residuals;
  options.parameter_blocks = blocks;
  options.num_threads = 1;
  Evaluated result;
  ceres::CRSMatrix crs;
  problem.Evaluate(options, &result.cost, &result.residuals, nullptr, &crs);
  result.J = Eigen::Map<const Sparse>(crs.num_rows, crs.num_cols,
                                      static_cast<Eigen::Index>(crs.values.size()), crs.rows.data(),
                                      crs.cols.data(), crs.values.data());
  return result;
}

}  // namespace

NormalEquations reduce(ceres::Problem& problem, MapProblem& map,
                       const std::vector<double*>& blocks) {
  std::vector<double*> all;
  for (Eigen::Vector3d& p : map.points()) {
    if (problem.HasParameterBlock(p.data())) all.push_back(p.data());
  }
  const auto points = static_cast<Eigen::Index>(3 * all.size());
  all.insert(all.end(), blocks.begin(), blocks.end());
  const Evaluated at = evaluate_blocks(problem, map.ids(), all);
  const Eigen::SparseMatrix<double> by_column = at.J;
  const Sparse J_points = by_column.leftCols(points);
  const Sparse J_others = by_column.rightCols(at.J.cols() - points);
  const Sparse factors = inverse_factors(J_points);
  const Sparse W = Sparse(J_points.transpose()) * J_others;
  const Sparse Z = factors * W;
  NormalEquations result;
  result.H = Sparse(J_others.transpose()) * J_others;
  result.H -= Eigen::SparseMatrix<double>(Sparse(Z.transpose()) * Z);
  result.gradients =
      reduced_sums(residuals_of_landmarks(J_points, at.residuals), J_points, J_others, factors, Z);
  result.shared = reduced_sums(errors_of_parts(map.rows()), J_points, J_others, factors, Z);
  result.chi2 = 2 * at.cost;
  result.residuals = at.J.rows();
  result.unknowns = at.J.cols();
  return result;
}

Eigen::SparseMatrix<double> information(ceres::Problem& problem,
                                        const std::vector<ceres::ResidualBlockId>& residuals,
                                        const std::vector<double*>& blocks) {
  const Sparse J = evaluate_blocks(problem, residuals, blocks).J;
  return Sparse(J.transpose()) * J;
}

Marginals::Marginals(const NormalEquations& measured, const Eigen::SparseMatrix<double>& others)
    : measured_(measured), others_(others) {
  Eigen::SparseMatrix<double> least(others.rows(), others.cols());
  least.setIdentity();
  others_ += kLeastInformation * least;
  const Eigen::SparseMatrix<double> H = measured.H + others_;
  solver_.compute(H);
  if (solver_.info() != Eigen::Success) throw InputError("the map does not determine its poses");
  const auto landmarks = static_cast<double>(measured.gradients.rows());
  const double share = static_cast<double>(H.rows()) / std::max(1.0, landmarks);
  few_ = 1 / (1 - std::min(share, 0.5));
}

Eigen::MatrixXd Marginals::covariance(const std::vector<Eigen::Index>& unknowns) const {
  const auto count = static_cast<Eigen::Index>(unknowns.size());
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(solver_.rows(), count);
  for (Eigen::Index k = 0; k < count; ++k) unit(unknowns[static_cast<std::size_t>(k)], k) = 1;
  const Eigen::MatrixXd x = solver_.solve(unit);
  const Eigen::MatrixXd each = measured_.gradients * x;
  const Eigen::MatrixXd shared = measured_.shared * x;
  const Eigen::MatrixXd of_others = others_ * x;
  return few_ * each.transpose() * each + shared.transpose() * shared + x.transpose() * of_others;
}

std::vector<double*> free_poses(const ceres::Problem& problem, MapProblem& map) {
  const std::vector<std::uint8_t> measured = map.measured_poses(problem);
  std::vector<double*> blocks;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    const bool free = measured[k] != 0 && !problem.IsParameterBlockConstant(map.pose(k));
    if (free) blocks.push_back(map.pose(k));
  }
  return blocks;
}

RigInformation rig_information(ceres::Problem& problem, MapProblem& map, double* shape) {
  const bool shape_held = problem.IsParameterBlockConstant(shape);
  const bool own_held = problem.IsParameterBlockConstant(map.own());
  if (shape_held) problem.SetParameterBlockVariable(shape);
  if (own_held) problem.SetParameterBlockVariable(map.own());
  std::vector<double*> blocks = free_poses(problem, map);
  const auto pose_unknowns = static_cast<Eigen::Index>((kPoseSize - 1) * blocks.size());
  blocks.push_back(shape);
  blocks.push_back(map.own());
  const NormalEquations reduced = reduce(problem, map, blocks);
  if (shape_held) problem.SetParameterBlockConstant(shape);
  if (own_held) problem.SetParameterBlockConstant(map.own());

  const Eigen::MatrixXd H = reduced.H;
  Eigen::MatrixXd H_poses = H.topLeftCorner(pose_unknowns, pose_unknowns);
  H_poses.diagonal().array() += kPoseDamping;
  const Eigen::MatrixXd mixed = H.topRightCorner(pose_unknowns, RigCorrection::kSize);
  RigInformation result;
  result.H = H.bottomRightCorner<RigCorrection::kSize, RigCorrection::kSize>() -
             mixed.transpose() * H_poses.llt().solve(mixed);
  result.chi2 = reduced.chi2;
  result.freedom = reduced.residuals - (reduced.unknowns - RigCorrection::kSize);
  return result;
}

}  // namespace kys_slam
