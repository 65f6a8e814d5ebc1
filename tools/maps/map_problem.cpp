// SPDX-License-Identifier: BSD-3-Clause
#include "map_problem.h"

#include <ceres/normal_prior.h>
#include <kys_slam/util/median.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>
#include <utility>

namespace kys_slam {

namespace {

constexpr double kHuber = 0.7;  // delta: errors are about half of what the deviations allow
constexpr double kGaussian = 1.4826;

template <typename F>
void for_each_observation(const MapObservations& map, F&& f) {
  for (std::size_t k = 0; k < map.landmarks.size(); ++k) {
    for (auto i = static_cast<std::size_t>(map.first[k]);
         i < static_cast<std::size_t>(map.first[k + 1]); ++i) {
      f(k, i);
    }
  }
}

}  // namespace

MapProblem::MapProblem(MapObservations& map, BlockMemory& memory)
    : map_(&map),
      shape_(memory.shape()),
      points_(memory.take_points(map)),
      poses_(memory.take_others(map)),
      of_rows_(map.observations.size(), 0),
      held_out_(map.observations.size(), 0),
      loss_(kHuber) {
  std::copy(map.landmarks.begin(), map.landmarks.end(), points_.begin());
  for (std::size_t k = 0; k < map.T_c_w.size(); ++k) {
    const PoseBlock block = to_block(map.T_c_w[k]);
    std::copy(block.begin(), block.end(), pose(k));
  }
}

ceres::Problem::Options MapProblem::problem_options() {
  ceres::Problem::Options ours;
  ours.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ours.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return ours;
}

void MapProblem::set_row_errors(const RigEstimate& known) {
  for (std::size_t i = 0; i < of_rows_.size(); ++i) {
    const RigCorrection::Measured& m = map_->observations[i].measured;
    if (std::isnan(m.u_right) || !std::isnan(m.v_right)) continue;
    of_rows_[i] = static_cast<float>(kSlope * known.sigma({m.u, m.v, m.u_right, m.v})[3]);
  }
}

Eigen::Vector4d MapProblem::weights(std::size_t i) const {
  Eigen::Vector4d weights = inverse_deviations(*map_, map_->observations[i]);
  weights[2] /= std::hypot(1, weights[2] * of_rows_[i]);
  return weights;
}

void MapProblem::hold_out(double share, std::mt19937_64& random) {
  const double most = share * 1e6;
  for (std::size_t k = 0; k < map_->landmarks.size(); ++k) {
    int left = map_->first[k + 1] - map_->first[k];
    for (auto i = static_cast<std::size_t>(map_->first[k]);
         i < static_cast<std::size_t>(map_->first[k + 1]); ++i) {
      const bool chosen = static_cast<double>(random() % 1000000) < most;
      if (!chosen || left <= kLeastObservers) continue;
      held_out_[i] = 1;
      --left;
    }
  }
}

RigCorrection MapProblem::rig() const {
  return {map_->camera, join(shape_, own())};
}

void MapProblem::set_rig(const RigCorrection::Parameters& parameters) {
  for (int k = 0; k < kShapeSize; ++k) {
    shape_[k] = parameters[shape_places().at(static_cast<std::size_t>(k))];
  }
  for (int k = 0; k < kOwnSize; ++k) {
    own()[k] = parameters[own_places().at(static_cast<std::size_t>(k))];
  }
}

/// Predicted less measured (u, v, disparity, row), px; NaN where nothing is measured.
Eigen::Vector4d MapProblem::residual(const RigCorrection& rig, std::size_t landmark,
                                     std::size_t i) const {
  const MapObservations::Observation& o = map_->observations[i];
  const Eigen::Vector3d p_c = to_pose(pose(o.keyframe)) * points_[landmark];
  if (p_c.z() < kNearest) return Eigen::Vector4d::Constant(std::nan(""));
  return predict(map_->camera, rig, p_c, false).value - measured_values(o.measured);
}

void MapProblem::choose(double far_off) {
  const RigCorrection rig = this->rig();
  active_.assign(map_->observations.size(), 0);
  for_each_observation(*map_, [&](std::size_t k, std::size_t i) {
    if (held_out_[i] != 0) return;
    Eigen::Vector4d e = residual(rig, k, i);
    e = e.cwiseProduct(weights(i));
    if (!std::isfinite(e[0])) return;
    const double disparity = std::isfinite(e[2]) ? e[2] * e[2] : 0;
    active_[i] = e.head<2>().squaredNorm() + disparity < far_off ? 1 : 0;
  });
  for (std::size_t k = 0; k < map_->landmarks.size(); ++k) {
    const auto begin = active_.begin() + map_->first[k];
    const auto end = active_.begin() + map_->first[k + 1];
    if (std::count(begin, end, 1) < kLeastObservers) std::fill(begin, end, std::uint8_t{0});
  }
}

void MapProblem::add_to(ceres::Problem& problem) {
  problem.AddParameterBlock(own(), kOwnSize);
  ids_.clear();
  for_each_observation(*map_, [&](std::size_t k, std::size_t i) {
    if (active_[i] == 0) return;
    const MapObservations::Observation& o = map_->observations[i];
    const Eigen::Vector4d inv_sigma = weights(i);
    ceres::CostFunction* cost = nullptr;
    if (std::isnan(o.measured.u_right)) {
      cost = new MeasuredCost<2>(&map_->camera, o.measured, inv_sigma);
    } else if (std::isnan(o.measured.v_right)) {
      cost = new MeasuredCost<3>(&map_->camera, o.measured, inv_sigma);
    } else {
      cost = new MeasuredCost<4>(&map_->camera, o.measured, inv_sigma);
    }
    ids_.push_back(
        problem.AddResidualBlock(cost, &loss_, pose(o.keyframe), points_[k].data(), shape_, own()));
  });
  // All of them: what is measured otherwise may be of a keyframe without observations.
  for (std::size_t k = 0; k < map_->T_c_w.size(); ++k) {
    problem.AddParameterBlock(pose(k), kPoseSize, &manifold_);
    if (map_->held[k] != 0) problem.SetParameterBlockConstant(pose(k));
  }
}

void MapProblem::order(const ceres::Problem& problem, ceres::ParameterBlockOrdering& ordering) {
  for (Eigen::Vector3d& p : points_) {
    if (problem.HasParameterBlock(p.data())) ordering.AddElementToGroup(p.data(), 0);
  }
  for (std::size_t k = 0; k < map_->T_c_w.size(); ++k) ordering.AddElementToGroup(pose(k), 1);
  ordering.AddElementToGroup(own(), 1);
}

Residuals MapProblem::residuals(bool held_out) const {
  std::array<std::vector<double>, 4> magnitudes;
  const RigCorrection rig = this->rig();
  for_each_observation(*map_, [&](std::size_t k, std::size_t i) {
    if ((held_out_[i] != 0) != held_out) return;
    const Eigen::Vector4d e = residual(rig, k, i) / map_->observations[i].scale;
    for (std::size_t c = 0; c < 4; ++c) {
      if (const double value = e[static_cast<Eigen::Index>(c)]; std::isfinite(value)) {
        magnitudes.at(c).push_back(std::abs(value));
      }
    }
  });
  Residuals result;
  for (std::size_t c = 0; c < 4; ++c) {
    std::vector<double>& values = magnitudes.at(c);
    result.count.at(c) = values.size();
    if (!values.empty()) result.sigma[static_cast<Eigen::Index>(c)] = kGaussian * median(values);
  }
  return result;
}

std::vector<MapProblem::Row> MapProblem::rows() const {
  std::vector<Row> rows;
  const auto part_of = [](double at, int size, int parts) {
    return std::clamp(static_cast<int>(at / size * parts), 0, parts - 1);
  };
  for (std::size_t i = 0; i < active_.size(); ++i) {
    if (active_[i] == 0) continue;
    const RigCorrection::Measured& m = map_->observations[i].measured;
    const int part = part_of(m.v, map_->camera.height, kRowsOfParts) * kColumns +
                     part_of(m.u, map_->camera.width, kColumns);
    const Eigen::Vector4d inv_sigma = weights(i);
    const int count = std::isnan(m.u_right) ? 2 : std::isnan(m.v_right) ? 3 : 4;
    for (int c = 0; c < count; ++c) {
      const double px = c == 2 ? std::hypot(kShared, of_rows_[i]) : kShared;
      rows.push_back({4 * part + c, px * inv_sigma[c]});
    }
  }
  return rows;
}

std::vector<std::uint8_t> MapProblem::measured_poses(const ceres::Problem& problem) const {
  std::unordered_set<const double*> blocks;
  std::vector<ceres::ResidualBlockId> residuals;
  problem.GetResidualBlocks(&residuals);
  std::vector<double*> of_one;
  for (const ceres::ResidualBlockId id : residuals) {
    problem.GetParameterBlocksForResidualBlock(id, &of_one);
    blocks.insert(of_one.begin(), of_one.end());
  }
  std::vector<std::uint8_t> measured;
  for (std::size_t k = 0; k < map_->T_c_w.size(); ++k) {
    measured.push_back(blocks.contains(pose(k)) ? 1 : 0);
  }
  return measured;
}

void MapProblem::carry_along(const ceres::Problem& problem) {
  const std::vector<std::uint8_t> measured = measured_poses(problem);
  const auto neighbour = [&](std::size_t k) {
    for (std::size_t off = 1; off < measured.size(); ++off) {
      for (const std::size_t j : {k - off, k + off}) {
        if (j >= measured.size()) continue;  // k - off below zero as well
        if (map_->submaps[j] == map_->submaps[k] && measured[j] != 0) return j;
      }
    }
    return k;
  };
  for (std::size_t k = 0; k < measured.size(); ++k) {
    if (measured[k] != 0 || map_->held[k] != 0) continue;
    const std::size_t j = neighbour(k);
    const Rigid3 T_k_j = map_->T_c_w[k] * map_->T_c_w[j].inverse();
    if (j == k) continue;
    const PoseBlock carried = to_block(T_k_j * to_pose(pose(j)));
    std::copy(carried.begin(), carried.end(), pose(k));
  }
}

void MapProblem::write() {
  for (std::size_t k = 0; k < map_->T_c_w.size(); ++k) map_->T_c_w[k] = to_pose(pose(k));
  for (std::size_t k = 0; k < points_.size(); ++k) {
    if (is_sound(k)) {
      map_->landmarks[k] = points_[k];
    } else {
      map_->landmarks[k].setConstant(std::nan(""));
    }
  }
}

bool MapProblem::is_sound(std::size_t k) const {
  const auto begin = active_.begin() + map_->first[k];
  const auto end = active_.begin() + map_->first[k + 1];
  bool sound = std::find(begin, end, 1) != end;
  for (auto i = static_cast<std::size_t>(map_->first[k]);
       i < static_cast<std::size_t>(map_->first[k + 1]); ++i) {
    const Rigid3 T_c_w = to_pose(pose(map_->observations[i].keyframe));
    sound = sound && (active_[i] == 0 || (T_c_w * points_[k]).z() > kNearest);
  }
  return sound;
}

template <int kBlock>
ceres::CostFunction* prior_cost(const RigCorrection::Covariance& covariance,
                                const RigCorrection::Parameters& mean,
                                const std::array<int, kBlock>& places) {
  Eigen::Matrix<double, kBlock, kBlock> block;
  ceres::Vector centre(kBlock);
  for (int a = 0; a < kBlock; ++a) {
    const int from = places.at(static_cast<std::size_t>(a));
    centre[a] = mean[from];
    for (int b = 0; b < kBlock; ++b) {
      block(a, b) = covariance(from, places.at(static_cast<std::size_t>(b)));
    }
  }
  const Eigen::Matrix<double, kBlock, kBlock> L = block.llt().matrixL();
  return new ceres::NormalPrior(ceres::Matrix(L.inverse()), centre);
}
template ceres::CostFunction* prior_cost<kShapeSize>(const RigCorrection::Covariance&,
                                                     const RigCorrection::Parameters&,
                                                     const std::array<int, kShapeSize>&);
template ceres::CostFunction* prior_cost<kOwnSize>(const RigCorrection::Covariance&,
                                                   const RigCorrection::Parameters&,
                                                   const std::array<int, kOwnSize>&);

}  // namespace kys_slam
