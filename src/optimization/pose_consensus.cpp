// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_consensus.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <utility>

#include "geometry/absolute_orientation.h"
#include "geometry/image_cells.h"
#include "geometry/reprojection.h"

namespace kys_slam {

void describe(kys::OptionList& list, ConsensusOptions& o) {
  list.add("tracking.image_area", o.enabled,
           "the pose with most image area in its inliers is used, not the one with most inliers");
  list.add("tracking.cell_columns", o.columns, {1, 1000}, "",
           "square cells across the image that measure area");
  list.add("tracking.outlier_area", o.contested, {0, 1}, "",
           "share of the area with outliers above which other poses are tried");
  list.add("tracking.consensus_tolerance", o.tolerance, {0.1, 100}, "",
           "factor on the error bound within which area supports a pose");
  list.add("tracking.consensus_priors", o.by_class,
           "modes kys and verified: an instance that can move counts once, by its prior, not by "
           "its area");
  list.add("tracking.cell_evidence", o.cell_evidence, {0.01, 100}, "nats",
           "evidence of one cell of the static scene for a pose, against the priors of instances");
  list.add("tracking.consensus_samples", o.samples, {0, 100000}, "", "number of other poses tried");
  list.add("tracking.consensus_seed", o.seed, {0, 1e9}, "",
           "seed of the random samples of other poses");
  const kys::OptionList::Fixed fixed(list);
  list.add("tracking.consensus_clear", o.clear, {1, 1000});
  list.add("tracking.consensus_reach", o.reach, {0.1, 1000});
  list.add("tracking.consensus_margin", o.margin, {1, 1000});
  list.add("tracking.consensus_acceleration", o.max_acceleration, {0.01, 1e6}, "m/s^2");
  list.add("tracking.doubtful_acceleration", o.doubtful_acceleration, {0.01, 1e6}, "m/s^2");
}
namespace {

constexpr std::size_t kSample = 3;
constexpr std::size_t kRefined = 5;    // samples that are refined
constexpr int kRefinements = 4;        // largest number per sample
constexpr std::size_t kMinScene = 10;  // observations of the fixed scene that can give a pose
constexpr double kSceneLead = 0.4;     // cells, of the fixed scene's pose over the initial pose
constexpr double kSureMembers = 4;  // observations from which a cell or an instance has full weight
constexpr std::size_t kPanel = 6;   // observations of a cell or an instance that judge a sample
constexpr double kStands = 0.5;     // least share of fitting observations of a static instance
constexpr double kKept = 0.95;      // least support after the last refinement over that before
constexpr double kImpossible =
    0.25;  // factor on the support of a pose with an impossible acceleration
constexpr double kInfinite = std::numeric_limits<double>::infinity();

using CellMembers = std::vector<std::vector<std::size_t>>;

/// The cells of the observations, and the weight of each observation in cells.
class SceneCells {
 public:
  SceneCells(const StereoCamera& camera, std::span<const PoseObservation> observations,
             std::span<const Vote> votes, const ConsensusOptions& options)
      : worth_(observations.size()), weight_(observations.size()), fixed_(observations.size()) {
    const ImageCells cells(camera, options.columns);
    members_.resize(cells.size());
    std::map<std::int32_t, Instance> instances;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const PoseObservation& o = observations[i];
      if (!is_usable(o.u, o.v, o.u_right, o.inv_sigma)) continue;
      members_[cells.index(o.u, o.v)].push_back(i);
      if (votes.empty() || votes[i].instance < 0) continue;
      Instance& instance = instances[votes[i].instance];
      instance.members.push_back(i);
      instance.cells = votes[i].log_odds / options.cell_evidence;
    }
    for (auto& [name, instance] : instances) {
      instance.cells *= weight_of(instance.members.size());
      instances_.push_back(std::move(instance));
    }
    std::erase_if(members_, [](const auto& cell) { return cell.empty(); });
    const auto fixed = [&](std::size_t i) { return votes.empty() || votes[i].instance < 0; };
    for (const auto& cell : members_) {
      std::vector<std::size_t> standing;
      std::copy_if(cell.begin(), cell.end(), std::back_inserter(standing), fixed);
      for (const std::size_t i : cell) {
        weight_[i] = observations[i].share / static_cast<float>(cell.size());
      }
      const double cell_weight = weight_of(standing.size());
      add(standing, cell_weight);
      area_ += cell_weight;
      for (const std::size_t i : standing) fixed_[i] = 1;
    }
    for (const Instance& instance : instances_) add(instance.members, instance.cells);
  }

  struct Instance {
    std::vector<std::size_t> members;
    double cells = 0;  ///< that it is worth where it stands still
  };

  /// Weight of each observation in the support of a pose that it fits, in cells.
  [[nodiscard]] const std::vector<double>& worth() const { return worth_; }
  /// A few observations that represent each cell and instance, and their weights, in cells.
  [[nodiscard]] const std::vector<std::size_t>& panel() const { return panel_; }
  [[nodiscard]] const std::vector<double>& panel_worth() const { return panel_worth_; }
  /// Area of the fixed scene, in cells.
  [[nodiscard]] double area() const { return area_; }
  /// Observations of each occupied cell.
  [[nodiscard]] const CellMembers& members() const { return members_; }
  [[nodiscard]] const std::vector<Instance>& instances() const { return instances_; }
  /// Whether an observation can be used and is of the fixed scene.
  [[nodiscard]] bool is_fixed(std::size_t i) const { return fixed_[i] != 0; }
  /// Weight of an observation in a fit in which all cells have the same weight.
  [[nodiscard]] float weight(std::size_t i) const { return weight_[i]; }

 private:
  /// Weight of a cell or an instance, 0..1. Few observations may be wrong, or on the edge of a
  /// moving object.
  static double weight_of(std::size_t members) {
    return std::min(1.0, static_cast<double>(members) / kSureMembers);
  }

  /// Adds observations with the weight `cells` in total.
  void add(const std::vector<std::size_t>& members, double cells) {
    const std::size_t n = members.size();
    for (const std::size_t i : members) worth_[i] = cells / static_cast<double>(n);
    const std::size_t few = std::min(n, kPanel);
    for (std::size_t k = 0; k < few; ++k) {
      panel_.push_back(members[(2 * k + 1) * n / (2 * few)]);
      panel_worth_.push_back(cells / static_cast<double>(few));
    }
  }

  CellMembers members_;
  std::vector<double> worth_;
  std::vector<std::size_t> panel_;
  std::vector<double> panel_worth_;
  std::vector<Instance> instances_;
  std::vector<float> weight_;
  std::vector<std::uint8_t> fixed_;
  double area_ = 0;
};

/// A pose and the area that supports it, in cells.
struct ScoredPose {
  Rigid3 T_c_w;
  double support = 0;
};

class Consensus {
 public:
  Consensus(const StereoCamera& camera, std::span<const PoseObservation> observations,
            std::span<const Vote> votes, const std::optional<ExpectedPose>& expected,
            const ConsensusOptions& options, const PoseOptions& pose)
      : camera_(camera),
        observations_(observations),
        expected_(expected),
        options_(options),
        pose_(pose),
        scene_(camera, observations, votes, options),
        errors_(camera, observations, pose),
        panel_errors_(camera, chosen(observations, scene_.panel()), pose) {}

  [[nodiscard]] double area() const { return scene_.area(); }

  /// Acceleration that leads to a pose from the expected motion, m/s^2; 0 without an expected
  /// motion.
  [[nodiscard]] double acceleration(const Rigid3& T_c_w) const {
    if (!expected_) return 0;
    const Eigen::Vector3d step = T_c_w.inverse_t() - expected_->T_c_w.inverse_t();
    return step.norm() / expected_->reach;
  }

  /// 1 for the expected motion; decreases to kImpossible with the acceleration. It never reaches 0:
  /// after a collision or with a wrong velocity the scene must be able to outvote the expectation.
  [[nodiscard]] double plausibility(const Rigid3& T_c_w) const {
    const double ratio = acceleration(T_c_w) / options_.max_acceleration;
    return kImpossible + (1 - kImpossible) / (1 + ratio * ratio);
  }

  /// Area of the fixed scene whose observations are within `factor` times their bound.
  [[nodiscard]] double fixed_support(const Rigid3& T_c_w, double factor) const {
    const std::vector<double> errors = errors_at(T_c_w);
    double sum = 0;
    for (std::size_t i = 0; i < errors.size(); ++i) {
      if (scene_.is_fixed(i) && errors[i] <= factor * factor) sum += scene_.worth()[i];
    }
    return sum;
  }

  /// A pose with its support: the area of its inliers, times its plausibility.
  [[nodiscard]] ScoredPose judged(const Rigid3& T_c_w) const {
    const double sum = support(errors_at(T_c_w), scene_.worth(), options_.tolerance);
    return {T_c_w, sum * plausibility(T_c_w)};
  }

  /// The same for a pose that is not refined yet, by a few observations of each cell.
  /// \param errors  memory that is used again
  [[nodiscard]] ScoredPose roughly_judged(const Rigid3& T_c_w, std::vector<double>& errors) const {
    panel_errors_.at(T_c_w, errors);
    const double sum = support(errors, scene_.panel_worth(), options_.reach);
    return {T_c_w, sum * plausibility(T_c_w)};
  }

  /// The pose with most support: `best`, or one near a sample of three matches that do not fit
  /// `T_c_w_votes`.
  [[nodiscard]] ScoredPose best_of_samples(const Rigid3& T_c_w_votes, ScoredPose best) const {
    for (const ScoredPose& sampled : best_samples(T_c_w_votes)) {
      const ScoredPose competing = refined(sampled.T_c_w);
      if (competing.support > best.support) best = competing;
    }
    return best;
  }

  /// The pose from the fixed scene alone; none without instances, or when the fixed scene is too
  /// small.
  [[nodiscard]] std::optional<ScoredPose> fixed_scene(const Rigid3& T_c_w) const {
    if (scene_.instances().empty()) return std::nullopt;
    std::vector<PoseObservation> fixed;
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      if (scene_.is_fixed(i)) fixed.push_back(observations_[i]);
    }
    if (fixed.size() < kMinScene) return std::nullopt;
    const PoseResult result = optimize_pose(camera_, T_c_w, fixed, pose_);
    if (result.inliers == 0) return std::nullopt;
    return judged(result.T_c_w);
  }

  /// Local optimisation over the observations near the pose, while the support increases.
  [[nodiscard]] ScoredPose refined(const Rigid3& T_c_w) const {
    ScoredPose best = judged(T_c_w);
    for (int k = 0; k < kRefinements; ++k) {
      const PoseResult result = optimize_near(best.T_c_w, options_.tolerance, true);
      const ScoredPose next = judged(result.T_c_w);
      if (result.inliers == 0 || next.support <= best.support) break;
      best = next;
    }
    return best;
  }

  /// The best pose, refined over the observations that fit it. Each has full weight, unless that
  /// reduces the support: many observations of a moving object can be within the bounds of the true
  /// pose too.
  [[nodiscard]] PoseResult final_pose(const ScoredPose& competing) const {
    PoseResult result = optimize_near(competing.T_c_w, 1, false);
    if (judged(result.T_c_w).support < kKept * competing.support) {
      result = optimize_near(competing.T_c_w, 1, true);
    }
    return result;
  }

  /// Optimises over the observations within `factor` times their bound of `T_c_w`; the result is
  /// indexed like all observations. `balanced`: all cells have the same weight, not all
  /// observations.
  [[nodiscard]] PoseResult optimize_near(const Rigid3& T_c_w, double factor, bool balanced) const {
    std::vector<double> errors = errors_at(T_c_w);
    for (const SceneCells::Instance& instance : scene_.instances()) {
      if (is_static(errors, instance)) continue;
      for (const std::size_t i : instance.members) errors[i] = kInfinite;
    }
    std::vector<PoseObservation> near;
    std::vector<std::size_t> at;
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      if (!(errors[i] <= factor * factor)) continue;
      near.push_back(observations_[i]);
      if (balanced) near.back().share = scene_.weight(i);
      at.push_back(i);
    }
    PoseResult result = optimize_pose(camera_, T_c_w, near, pose_);
    std::vector<std::uint8_t> outlier(observations_.size(), 1);
    for (std::size_t k = 0; k < at.size(); ++k) outlier[at[k]] = result.outlier[k];
    result.outlier = std::move(outlier);
    return result;
  }

  /// The few samples with most support, best first.
  [[nodiscard]] std::vector<ScoredPose> best_samples(const Rigid3& T_c_w_votes) const {
    std::vector<ScoredPose> best;
    std::array<CellMembers, 2> cells;
    cells[1] = unexplained(T_c_w_votes, false);
    cells[0] = scene_.instances().empty() ? cells[1] : unexplained(T_c_w_votes, true);
    std::mt19937_64 random(options_.seed);
    std::vector<double> errors;
    for (int k = 0; k < options_.samples; ++k) {
      const CellMembers& from = cells[static_cast<std::size_t>(k) % cells.size()];
      if (from.size() < kSample) continue;
      const std::optional<Rigid3> T_c_w = sample_pose(from, random);
      if (!T_c_w) continue;
      const ScoredPose competing = roughly_judged(*T_c_w, errors);
      const auto place = std::find_if(best.begin(), best.end(), [&](const ScoredPose& other) {
        return competing.support > other.support;
      });
      best.insert(place, competing);
      if (best.size() > kRefined) best.pop_back();
    }
    return best;
  }

  /// Stereo observations out of reach of a pose, by cell; those of the fixed scene or all.
  [[nodiscard]] CellMembers unexplained(const Rigid3& T_c_w, bool fixed) const {
    const std::vector<double> errors = errors_at(T_c_w);
    CellMembers cells;
    for (const auto& members : scene_.members()) {
      std::vector<std::size_t> rest;
      for (const std::size_t i : members) {
        const PoseObservation& o = observations_[i];
        if (fixed && !scene_.is_fixed(i)) continue;
        if (errors[i] > options_.reach * options_.reach && o.u - o.u_right > 0) rest.push_back(i);
      }
      if (!rest.empty()) cells.push_back(std::move(rest));
    }
    return cells;
  }

  /// Pose from one match of each of three cells.
  [[nodiscard]] std::optional<Rigid3> sample_pose(const CellMembers& cells,
                                                  std::mt19937_64& random) const {
    std::array<std::size_t, kSample> chosen{};
    std::array<Eigen::Vector3d, kSample> p_c;
    std::array<Eigen::Vector3d, kSample> p_w;
    for (std::size_t k = 0; k < kSample; ++k) {
      chosen[k] = static_cast<std::size_t>(random() % cells.size());
      const auto& members = cells[chosen[k]];
      const PoseObservation& o = observations_[members[random() % members.size()]];
      const double disparity = o.u - o.u_right;
      const bool again = std::find(chosen.begin(), chosen.begin() + static_cast<std::ptrdiff_t>(k),
                                   chosen[k]) != chosen.begin() + static_cast<std::ptrdiff_t>(k);
      if (again) return std::nullopt;
      p_c[k] = camera_.back_project(o.u, o.v, camera_.bf() / disparity);
      p_w[k] = o.p_w;
    }
    return absolute_orientation(p_c, p_w);
  }

 private:
  [[nodiscard]] static std::vector<PoseObservation> chosen(
      std::span<const PoseObservation> observations, const std::vector<std::size_t>& which) {
    std::vector<PoseObservation> result;
    result.reserve(which.size());
    for (const std::size_t i : which) result.push_back(observations[i]);
    return result;
  }

  [[nodiscard]] std::vector<double> errors_at(const Rigid3& T_c_w) const {
    std::vector<double> errors;
    errors_.at(T_c_w, errors);
    return errors;
  }

  /// Sum of the weights of the observations, each reduced by its error: the full weight for error
  /// 0, 0 from `factor` times its bound.
  [[nodiscard]] static double support(const std::vector<double>& errors,
                                      const std::vector<double>& worth, double factor) {
    double sum = 0;
    for (std::size_t i = 0; i < errors.size(); ++i) {
      sum += worth[i] * std::max(0.0, 1 - errors[i] / (factor * factor));
    }
    return std::max(sum, 0.0);
  }

  /// Whether an instance is static under a pose: many of its observations fit.
  [[nodiscard]] bool is_static(const std::vector<double>& errors,
                               const SceneCells::Instance& instance) const {
    const double bound = options_.tolerance * options_.tolerance;
    const auto count = std::count_if(instance.members.begin(), instance.members.end(),
                                     [&](std::size_t i) { return errors[i] <= bound; });
    return static_cast<double>(count) >= kStands * static_cast<double>(instance.members.size());
  }

  const StereoCamera& camera_;
  std::span<const PoseObservation> observations_;
  std::optional<ExpectedPose> expected_;
  const ConsensusOptions& options_;
  const PoseOptions& pose_;
  SceneCells scene_;
  PoseErrors errors_;
  PoseErrors panel_errors_;
};

}  // namespace

/// The steps in the order of their cost. A static scene ends after the first one: the pose with
/// most matches also has nearly all of the area. The pose of the fixed scene has to lead by a
/// whole cell, since it is made of fewer observations. Competing poses are searched where area is
/// left over: from the pose that was given, from that of the fixed scene, and from samples of what
/// the pose leaves out, which finds the scene when a vehicle holds the first two. Last, all
/// inliers of the winner count fully, as accuracy comes from their number.
ConsensusResult estimate_pose(const StereoCamera& camera, const Rigid3& T_c_w_initial,
                              std::span<const PoseObservation> observations,
                              std::span<const Vote> votes,
                              const std::optional<ExpectedPose>& expected,
                              const ConsensusOptions& options, Start start,
                              const PoseOptions& pose) {
  ConsensusResult result;
  if (start == Start::kGuess) {
    result.pose = optimize_pose(camera, T_c_w_initial, observations, pose);
  }
  if (!options.enabled || observations.empty()) return result;
  const Consensus consensus(camera, observations, votes, expected, options, pose);
  if (start == Start::kConsensus) {
    ScoredPose best = consensus.refined(T_c_w_initial);
    const ScoredPose competing = consensus.best_of_samples(best.T_c_w, best);
    if (competing.support > options.margin * best.support) best = competing;
    result.pose = consensus.final_pose(best);
    result.contested = result.overruled = true;
    return result;
  }
  const std::optional<ScoredPose> scene = consensus.fixed_scene(result.pose.T_c_w);
  const double explained = consensus.fixed_support(result.pose.T_c_w, options.clear);
  result.contested = consensus.area() == 0 ||  // only instances that can move
                     explained < (1 - options.contested) * consensus.area() ||
                     consensus.acceleration(result.pose.T_c_w) > options.doubtful_acceleration;
  if (!scene && !result.contested) return result;
  const double wanted = options.margin * consensus.judged(result.pose.T_c_w).support;
  ScoredPose best{result.pose.T_c_w, wanted};
  if (scene && scene->support > wanted + 1) best = *scene;
  if (result.contested) {
    ScoredPose competing = consensus.refined(T_c_w_initial);
    if (scene) {
      const ScoredPose other = consensus.refined(scene->T_c_w);
      if (other.support > competing.support + kSceneLead) competing = other;
    }
    competing = consensus.best_of_samples(result.pose.T_c_w, competing);
    if (competing.support > best.support) best = competing;
  }
  if (best.support <= wanted) return result;
  result.overruled = true;
  result.pose = consensus.final_pose(best);
  return result;
}

}  // namespace kys_slam
