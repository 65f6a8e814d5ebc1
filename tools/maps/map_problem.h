// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <kys_slam/map_observations.h>

#include <array>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "block_memory.h"
#include "rig_costs.h"
#include "solve_round.h"

namespace kys_slam {

/// Robust standard deviations of residuals (u, v, disparity, row), px of their octaves, and how
/// many there are.
struct Residuals {
  Eigen::Vector4d sigma = Eigen::Vector4d::Zero();
  std::array<std::size_t, 4> count{};
};

/// One map in a Ceres problem, which can have residuals of other measurements as well: a block of
/// kPoseSize per keyframe (PoseManifold), three numbers per landmark, and the rig's correction in
/// two blocks, of which the shape may be common to several maps. Costs by the map's noise model
/// with Huber's loss.
class MapProblem {
 public:
  static constexpr double kAll = 1e30;       ///< for choose(): none is too far off
  static constexpr double kFarOff = 25;      ///< chi2 of an observation that is left out
  static constexpr int kLeastObservers = 2;  ///< of a landmark, without those held out

  /// \param map  must outlive the problem, as must \p memory, which has been made for it
  MapProblem(MapObservations& map, BlockMemory& memory);
  MapProblem(const MapProblem&) = delete;
  MapProblem& operator=(const MapProblem&) = delete;

  /// Options with which Ceres problems for these blocks are made.
  static ceres::Problem::Options problem_options();

  /// px of disparity per px of row between places that were compared as one row: the slope of
  /// surfaces and of edges, of roads 0.3 (baseline over height).
  static constexpr double kSlope = 0.3;
  /// Disparities whose rows have not been measured get an error of first order from these: the
  /// images were compared in rows that do not correspond.
  /// \param known of the correction with which the map was made
  void set_row_errors(const RigEstimate& known);
  /// Leaves out a share of the observations, which are predicted only. The same generator and map
  /// give the same choice.
  void hold_out(double share, std::mt19937_64& random);
  /// Uses them from now on.
  void use_held_out() { held_out_.assign(held_out_.size(), 0); }
  /// Leaves out what is far off at the present place, behind the camera, or of a landmark that few
  /// views remain of, until the next call.
  void choose(double far_off);
  /// Adds the blocks, poses of all keyframes among them, and the observations that were chosen.
  void add_to(ceres::Problem& problem);
  /// Landmarks are eliminated first.
  void order(const ceres::Problem& problem, ceres::ParameterBlockOrdering& ordering);

  /// Block of a keyframe, T_c_w as to_block() has it. A cost gives its derivatives by the increment
  /// x_c -> exp(w) x_c + v in the first six of seven columns.
  [[nodiscard]] double* pose(std::size_t keyframe) const { return poses_ + kPoseSize * keyframe; }
  /// Blocks of the landmarks, p_w.
  [[nodiscard]] std::span<Eigen::Vector3d> points() const { return points_; }
  [[nodiscard]] double* own() const { return pose(map_->T_c_w.size()); }
  /// The map as it was read, until write().
  [[nodiscard]] MapObservations& map() { return *map_; }
  /// Of the observations that were added last.
  [[nodiscard]] const std::vector<ceres::ResidualBlockId>& ids() const { return ids_; }
  /// px, standard deviation of an error that all observations in a part of the images share:
  /// matching of corners that a perspective changes, lenses beyond the model.
  static constexpr double kShared = 0.03;
  /// Of every residual (row) of these: the part of the images that it is of, with what is measured
  /// there, and its change by an error of one standard deviation that all in this part share.
  struct Row {
    int part = 0;
    double shared = 0;
  };
  static constexpr int kColumns = 6, kRowsOfParts = 3;  ///< parts of the images
  static constexpr int kParts = 4 * kColumns * kRowsOfParts;
  [[nodiscard]] std::vector<Row> rows() const;
  [[nodiscard]] RigCorrection rig() const;
  void set_rig(const RigCorrection::Parameters& parameters);

  /// At the present place, of observations that are held out, or of the others.
  [[nodiscard]] Residuals residuals(bool held_out) const;
  /// Per keyframe: 1 where a residual is on its pose.
  [[nodiscard]] std::vector<std::uint8_t> measured_poses(const ceres::Problem& problem) const;
  /// Keyframes without a residual move with the nearest one that has some, of their sub-map.
  void carry_along(const ceres::Problem& problem);
  /// Poses and landmarks into the map. Landmarks that were not added last, or are behind a camera
  /// that observes them, become NaN: SavedMap::update leaves these where their reference keyframe
  /// has them.
  void write();

 private:
  [[nodiscard]] Eigen::Vector4d residual(const RigCorrection& rig, std::size_t landmark,
                                         std::size_t observation) const;
  /// 1/px of (u, v, disparity, row).
  [[nodiscard]] Eigen::Vector4d weights(std::size_t observation) const;
  [[nodiscard]] bool is_sound(std::size_t landmark) const;

  MapObservations* map_;
  double* shape_;
  std::span<Eigen::Vector3d> points_;
  double* poses_;
  std::vector<float> of_rows_;          // per observation: px, error of the disparity by its row
  std::vector<std::uint8_t> held_out_;  // per observation
  std::vector<std::uint8_t> active_;    // per observation: chosen
  std::vector<ceres::ResidualBlockId> ids_;
  ceres::HuberLoss loss_;
  PoseManifold manifold_;
};

/// Normal prior on one of the rig's two blocks.
template <int kBlock>
ceres::CostFunction* prior_cost(const RigCorrection::Covariance& covariance,
                                const RigCorrection::Parameters& mean,
                                const std::array<int, kBlock>& places);

}  // namespace kys_slam
