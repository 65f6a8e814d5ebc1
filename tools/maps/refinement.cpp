// SPDX-License-Identifier: BSD-3-Clause
#include "refinement.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <random>
#include <span>
#include <utility>

#include "marginals.h"

namespace kys_slam {

namespace {

struct Group {
  std::string_view name;
  std::vector<RigParameter> parameters;
};
const std::array<Group, 5>& groups() {
  using enum RigParameter;
  static const std::array<Group, 5> kGroups = {
      {{"offset", {kOffset, kRow}},
       {"intrinsics", {kRatio, kFocal}},
       {"baseline", {kBaselineY, kBaselineZ}},
       {"rotation", {kYaw, kPitch, kRoll}},
       {"distortion",
        {kLeftK1, kLeftK2, kLeftP1, kLeftP2, kRightK1, kRightK2, kRightP1, kRightP2}}}};
  return kGroups;
}

struct Round {
  double far_off;
  int iterations;
};
constexpr Round kAsInMap{MapProblem::kAll, 30};
constexpr Round kLast{MapProblem::kFarOff, 20};
// The first round has all: with other poses or another correction what is far off need not be
// wrong.
constexpr std::array kRigRounds = {Round{MapProblem::kAll, 300}, Round{MapProblem::kFarOff, 100},
                                   Round{MapProblem::kFarOff, 100}};
constexpr std::array kPlainRounds = {Round{MapProblem::kAll, 30}, Round{MapProblem::kFarOff, 20}};

template <std::size_t kBlock>
std::vector<int> held_in(const std::array<int, kBlock>& places, const FreeParameters& free) {
  std::vector<int> held;
  for (std::size_t k = 0; k < kBlock; ++k) {
    if (!free.at(static_cast<std::size_t>(places[k]))) held.push_back(static_cast<int>(k));
  }
  return held;
}

/// The block's held entries stay.
void hold(ceres::Problem& problem, double* block, int size, const std::vector<int>& held,
          std::unique_ptr<ceres::SubsetManifold>& manifold) {
  if (static_cast<int>(held.size()) == size) {
    problem.SetParameterBlockConstant(block);
  } else if (!held.empty()) {
    manifold = std::make_unique<ceres::SubsetManifold>(size, held);
    problem.SetManifold(block, manifold.get());
  }
}

class Refinement {
 public:
  Refinement(MapObservations& map, const RefinementOptions& options)
      : options_(options), memory_(map), map_(map, memory_) {
    std::mt19937_64 random(options.seed);
    map_.hold_out(options.hold_out, random);
    map_.set_rig(map.rig.correction.parameters());
    map_.set_row_errors(before());
    any_free_ = std::any_of(options.free.begin(), options.free.end(), [](bool f) { return f; });
  }

  RefinementResult run() {
    RefinementResult result;
    result.before = result.after = map_.map().rig;
    result.read = stage();
    const std::span<const Round> rounds =
        any_free_ ? std::span<const Round>(kRigRounds) : std::span<const Round>(kPlainRounds);
    for (const Round& r : rounds) most_ += r.iterations;
    most_ += kLast.iterations;
    if (any_free_) {
      most_ += kAsInMap.iterations;
      solve("with the correction in the map", false, kAsInMap, result);
      result.adjusted = stage();
    }
    for (const Round& r : rounds) {
      if (!result.stopped) solve("refined", any_free_, r, result);
    }
    result.refined = stage();
    if (!any_free_) result.adjusted = result.refined;
    // The figures are told: the map is that of all observations.
    if (options_.hold_out > 0 && !result.stopped) {
      map_.use_held_out();
      solve("with all observations", any_free_, kLast, result);
    }
    result.observations = map_.ids().size();
    // An interrupt keeps what there is: a covariance of a place that is not the minimum as well.
    finish(result);
    map_.carry_along(*problem_);
    map_.write();
    map_.map().rig = result.after;
    return result;
  }

 private:
  /// The correction that images were compared with, and what is not known about its free
  /// parameters: as the run knew them, or the prior.
  [[nodiscard]] RigEstimate before() {
    RigEstimate known = options_.compared_with.value_or(map_.map().rig);
    for (int k = 0; k < RigCorrection::kSize; ++k) {
      const bool free = options_.free.at(static_cast<std::size_t>(k));
      if (free && known.covariance(k, k) > 0) continue;
      known.covariance.row(k).setZero();
      known.covariance.col(k).setZero();
      if (free) known.covariance(k, k) = options_.prior.covariance(k, k);
    }
    return known;
  }

  [[nodiscard]] RefinementResult::Stage stage() const {
    return {map_.residuals(false), map_.residuals(true)};
  }

  void build(bool rig_free, double far_off) {
    problem_ = std::make_unique<ceres::Problem>(MapProblem::problem_options());
    problem_->AddParameterBlock(memory_.shape(), kShapeSize);
    map_.choose(far_off);
    map_.add_to(*problem_);
    const FreeParameters free = rig_free ? options_.free : FreeParameters{};
    hold(*problem_, memory_.shape(), kShapeSize, held_in(shape_places(), free), shape_manifold_);
    hold(*problem_, map_.own(), kOwnSize, held_in(own_places(), free), own_manifold_);
    const RigCorrection::Parameters mean = options_.prior.correction.parameters();
    const RigCorrection::Covariance& around = options_.prior.covariance;
    problem_->AddResidualBlock(prior_cost<kShapeSize>(around, mean, shape_places()), nullptr,
                               memory_.shape());
    problem_->AddResidualBlock(prior_cost<kOwnSize>(around, mean, own_places()), nullptr,
                               map_.own());
    if (options_.more) options_.more(*problem_, map_);
  }

  void solve(const std::string& what, bool rig_free, const Round& r, RefinementResult& result) {
    build(rig_free, r.far_off);
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    map_.order(*problem_, *ordering);
    ordering->AddElementToGroup(memory_.shape(), 1);
    add_others(*ordering);
    const SolveRound round{what, r.iterations, most_, 1e-7};
    result.stopped = !solve_round(*problem_, ordering, round, options_.watch, result.iterations);
  }

  /// Blocks that others have added.
  void add_others(ceres::ParameterBlockOrdering& ordering) const {
    std::vector<double*> blocks;
    problem_->GetParameterBlocks(&blocks);
    for (double* block : blocks) {
      if (!ordering.IsMember(block)) ordering.AddElementToGroup(block, 1);
    }
  }

  /// Blocks whose covariance is wanted, poses first: all variable ones but landmarks.
  [[nodiscard]] std::vector<double*> variable_blocks() {
    std::vector<double*> blocks = free_poses(*problem_, map_);
    ceres::ParameterBlockOrdering of_map;
    map_.order(*problem_, of_map);  // and poses, and the map's own
    std::vector<double*> all;
    problem_->GetParameterBlocks(&all);
    for (double* block : all) {
      const bool known = of_map.IsMember(block) && block != map_.own();
      if (!known && !problem_->IsParameterBlockConstant(block)) blocks.push_back(block);
    }
    return blocks;
  }

  /// Standard deviations: what the map measured is as good as its residuals; priors and what others
  /// measured are as they are.
  void finish(RefinementResult& result) {
    std::vector<double*> blocks = variable_blocks();
    const NormalEquations measured = reduce(*problem_, map_, blocks);
    result.unit = std::sqrt(measured.chi2 / static_cast<double>(std::max<std::int64_t>(
                                                1, measured.residuals - measured.unknowns)));
    if (any_free_) result.after.correction = map_.rig();
    if (!any_free_ && !options_.covariances) return;
    std::vector<ceres::ResidualBlockId> others;
    problem_->GetResidualBlocks(&others);
    std::vector<ceres::ResidualBlockId> ours = map_.ids();
    std::sort(ours.begin(), ours.end());
    std::erase_if(others, [&](ceres::ResidualBlockId id) {
      return std::binary_search(ours.begin(), ours.end(), id);
    });
    const Marginals marginals(measured, information(*problem_, others, blocks));
    Eigen::Index column = 0;
    Starts starts;
    for (double* block : blocks) {
      starts.emplace_back(block, column);
      column += problem_->ParameterBlockTangentSize(block);
    }
    if (any_free_) rig_covariance(marginals, starts, result);
    if (options_.covariances) pose_covariances(marginals, starts, result);
  }

  using Starts = std::vector<std::pair<double*, Eigen::Index>>;

  /// Of the free parameters; the others have what they had, or the prior.
  void rig_covariance(const Marginals& marginals, const Starts& starts, RefinementResult& result) {
    std::vector<std::pair<int, Eigen::Index>> columns;  // place, column
    for (const auto& [block, start] : starts) {
      Eigen::Index at = start;
      const auto add = [&](const auto& places) {
        for (const int place : places) {
          if (options_.free.at(static_cast<std::size_t>(place))) columns.emplace_back(place, at++);
        }
      };
      if (block == memory_.shape()) add(shape_places());
      if (block == map_.own()) add(own_places());
    }
    RigCorrection::Covariance& covariance = result.after.covariance;
    for (int k = 0; k < RigCorrection::kSize; ++k) {
      // What stays is as well known as before.
      if (!options_.free.at(static_cast<std::size_t>(k)) && covariance(k, k) > 0) continue;
      covariance.row(k).setZero();
      covariance.col(k).setZero();
      covariance(k, k) = options_.prior.covariance(k, k);
    }
    std::vector<Eigen::Index> wanted;
    for (const auto& [place, column] : columns) wanted.push_back(column);
    const Eigen::MatrixXd found = marginals.covariance(wanted);
    for (std::size_t a = 0; a < columns.size(); ++a) {
      for (std::size_t b = 0; b < columns.size(); ++b) {
        covariance(columns[a].first, columns[b].first) =
            found(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b));
      }
    }
  }

  void pose_covariances(const Marginals& marginals, const Starts& starts,
                        RefinementResult& result) {
    const std::size_t poses = map_.map().T_c_w.size();
    for (std::size_t k = 0; k < poses; ++k) {
      const double unknown = map_.map().held[k] != 0 ? 0 : 1 / Marginals::kLeastInformation;
      result.covariances.emplace_back(unknown * Eigen::Matrix<double, 6, 6>::Identity());
    }
    std::size_t next = 0;  // the blocks begin with the free poses, in their order
    for (std::size_t k = 0; k < poses && next < starts.size(); ++k) {
      const auto& [block, start] = starts[next];
      if (map_.pose(k) != block) continue;
      ++next;
      std::vector<Eigen::Index> wanted(6);
      std::iota(wanted.begin(), wanted.end(), start);
      result.covariances[k] = marginals.covariance(wanted);
    }
  }

  const RefinementOptions& options_;
  bool any_free_ = false;
  int most_ = 0;  // iterations
  BlockMemory memory_;
  MapProblem map_;
  std::unique_ptr<ceres::SubsetManifold> shape_manifold_, own_manifold_;
  std::unique_ptr<ceres::Problem> problem_;  // uses all of these
};

}  // namespace

const std::vector<std::string_view>& rig_groups() {
  static const std::vector<std::string_view> kNames = [] {
    std::vector<std::string_view> names;
    for (const Group& group : groups()) names.push_back(group.name);
    return names;
  }();
  return kNames;
}

FreeParameters parse_groups(const std::vector<std::string>& names) {
  FreeParameters free{};
  for (const std::string& name : names) {
    const auto group = std::find_if(groups().begin(), groups().end(),
                                    [&](const Group& g) { return g.name == name; });
    if (group == groups().end()) {
      throw InputError("'" + name +
                       "' is no group of parameters: offset, intrinsics, baseline, rotation, "
                       "distortion");
    }
    for (const RigParameter p : group->parameters) free.at(static_cast<std::size_t>(p)) = true;
  }
  return free;
}

RefinementResult refine(MapObservations& map, const RefinementOptions& options) {
  return Refinement(map, options).run();
}

}  // namespace kys_slam
