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
namespace {

constexpr std::size_t kSample = 3;
constexpr std::size_t kRefined = 5;    // samples that are refined
constexpr int kRefinements = 4;        // of one sample, while its support grows
constexpr std::size_t kMinScene = 10;  // observations of the fixed scene that can give a pose
constexpr double kSureMembers = 4;     // observations from which a thing has its whole say
constexpr double kStands = 0.5;        // share of its observations that fit, of a thing that stands
constexpr double kKept = 0.95;         // share of the support that the last refinement has to keep
constexpr double kImpossible =
    0.25;  // factor on the support of a pose that no acceleration explains

using CellMembers = std::vector<std::vector<std::size_t>>;

/// The cells of the observations and what each observation stands for.
class SceneCells {
 public:
  SceneCells(const StereoCamera& camera, std::span<const PoseObservation> observations,
             std::span<const Vote> votes, const ConsensusOptions& options)
      : weight_(observations.size()), share_(observations.size()) {
    const ImageCells cells(camera, options.columns);
    members_.resize(cells.size());
    std::map<std::int32_t, Thing> things;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const PoseObservation& o = observations[i];
      if (!is_usable(o.u, o.v, o.u_right, o.inv_sigma)) continue;
      members_[cells.index(o.u, o.v)].push_back(i);
      if (votes.empty() || votes[i].thing < 0) continue;
      Thing& thing = things[votes[i].thing];
      thing.members.push_back(i);
      thing.cells = votes[i].log_odds / options.cell_evidence;
    }
    for (auto& [name, thing] : things) {
      const auto count = static_cast<double>(thing.members.size());
      thing.cells *= std::min(1.0, count / kSureMembers);
      things_.push_back(std::move(thing));
    }
    std::erase_if(members_, [](const auto& cell) { return cell.empty(); });
    const auto fixed = [&](std::size_t i) { return votes.empty() || votes[i].thing < 0; };
    for (const auto& cell : members_) {
      const auto stand = std::count_if(cell.begin(), cell.end(), fixed);
      for (const std::size_t i : cell) {
        weight_[i] = observations[i].share / static_cast<float>(cell.size());
        if (fixed(i)) share_[i] = 1 / static_cast<float>(stand);
      }
      area_ += stand > 0 ? 1 : 0;
    }
  }

  struct Thing {
    std::vector<std::size_t> members;
    double cells = 0;  ///< that it is worth where it stands still
  };

  /// Of the fixed scene, in cells.
  [[nodiscard]] double area() const { return area_; }
  /// Observations of each occupied cell.
  [[nodiscard]] const CellMembers& members() const { return members_; }
  [[nodiscard]] const std::vector<Thing>& things() const { return things_; }
  /// What one observation of the fixed scene stands for, in cells; 0 for one of a thing.
  [[nodiscard]] float share(std::size_t i) const { return share_[i]; }
  /// In a fit in which cells weigh the same.
  [[nodiscard]] float weight(std::size_t i) const { return weight_[i]; }

 private:
  CellMembers members_;
  std::vector<Thing> things_;
  std::vector<float> weight_;
  std::vector<float> share_;
  double area_ = 0;
};

/// A pose and the area that supports it, in cells.
struct Rival {
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
        scene_(camera, observations, votes, options) {}

  [[nodiscard]] double area() const { return scene_.area(); }

  /// 1 for the motion expected, falling to kImpossible for one that no vehicle can make.
  [[nodiscard]] double plausibility(const Rigid3& T_c_w) const {
    if (!expected_) return 1;
    const Eigen::Vector3d step = T_c_w.inverse_t() - expected_->T_c_w.inverse_t();
    const double acceleration = step.norm() / (expected_->interval * expected_->interval);
    const double ratio = acceleration / options_.max_acceleration;
    return kImpossible + (1 - kImpossible) / (1 + ratio * ratio);
  }

  /// Area of the fixed scene whose observations are within `factor` times their bound, each
  /// counting less the worse it fits if `graded`.
  [[nodiscard]] double fixed_support(const Rigid3& T_c_w, double factor, bool graded) const {
    double sum = 0;
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      if (scene_.share(i) > 0) sum += scene_.share(i) * fit(T_c_w, i, factor, graded);
    }
    return sum;
  }

  /// 1 for an observation that fits, 0 for one beyond `factor` times its bound.
  [[nodiscard]] double fit(const Rigid3& T_c_w, std::size_t i, double factor, bool graded) const {
    const double error = relative_error(T_c_w, observations_[i]) / (factor * factor);
    return error <= 1 ? (graded ? 1 - error : 1) : 0;
  }

  /// Mean fit of a thing's observations.
  [[nodiscard]] double fit(const Rigid3& T_c_w, const SceneCells::Thing& thing, double factor,
                           bool graded) const {
    double sum = 0;
    for (const std::size_t i : thing.members) sum += fit(T_c_w, i, factor, graded);
    return sum / static_cast<double>(thing.members.size());
  }

  /// In cells: what the fixed scene and the things say for a pose.
  [[nodiscard]] double support(const Rigid3& T_c_w, double factor) const {
    double sum = fixed_support(T_c_w, factor, true);
    for (const SceneCells::Thing& thing : scene_.things()) {
      sum += thing.cells * fit(T_c_w, thing, factor, true);
    }
    return std::max(sum, 0.0);
  }

  /// What speaks for a pose: the area that supports it, less where it is no likely motion.
  [[nodiscard]] Rival judged(const Rigid3& T_c_w, double factor) const {
    return {T_c_w, support(T_c_w, factor) * plausibility(T_c_w)};
  }

  /// The pose with most support of those near `T_c_w_initial` and near samples of three matches
  /// that do not fit `T_c_w_votes`.
  [[nodiscard]] Rival best_rival(const Rigid3& T_c_w_votes, const Rigid3& T_c_w_initial) const {
    Rival best = refined(T_c_w_initial);
    for (const Rival& sampled : best_samples(T_c_w_votes)) {
      const Rival rival = refined(sampled.T_c_w);
      if (rival.support > best.support) best = rival;
    }
    return best;
  }

  /// The pose that the fixed scene alone gives; none where there are no things or too little else.
  [[nodiscard]] std::optional<Rival> fixed_scene(const Rigid3& T_c_w) const {
    if (scene_.things().empty()) return std::nullopt;
    std::vector<PoseObservation> fixed;
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      if (scene_.share(i) > 0) fixed.push_back(observations_[i]);
    }
    if (fixed.size() < kMinScene) return std::nullopt;
    const PoseResult result = optimize_pose(camera_, T_c_w, fixed, pose_);
    if (result.inliers == 0) return std::nullopt;
    return judged(result.T_c_w, options_.tolerance);
  }

  /// Local optimisation: over what is near, as long as that gains support.
  [[nodiscard]] Rival refined(const Rigid3& T_c_w) const {
    Rival best = judged(T_c_w, options_.tolerance);
    for (int k = 0; k < kRefinements; ++k) {
      const PoseResult result = optimize_near(best.T_c_w, options_.tolerance, true);
      const Rival next = judged(result.T_c_w, options_.tolerance);
      if (result.inliers == 0 || next.support <= best.support) break;
      best = next;
    }
    return best;
  }

  /// The pose that won, refined over the observations that fit it. Each has full weight unless that
  /// loses support: much of a mover can be within the bounds of the true pose as well.
  [[nodiscard]] PoseResult final_pose(const Rival& rival) const {
    PoseResult result = optimize_near(rival.T_c_w, 1, false);
    if (judged(result.T_c_w, options_.tolerance).support < kKept * rival.support) {
      result = optimize_near(rival.T_c_w, 1, true);
    }
    return result;
  }

  /// Optimises over the observations within `factor` times their bound of `T_c_w`; the result is
  /// indexed like all observations. `balanced`: cells weigh the same, not observations.
  [[nodiscard]] PoseResult optimize_near(const Rigid3& T_c_w, double factor, bool balanced) const {
    std::vector<PoseObservation> near;
    std::vector<std::size_t> at;
    std::vector<std::uint8_t> moves(observations_.size(), 0);
    for (const SceneCells::Thing& thing : scene_.things()) {
      if (fit(T_c_w, thing, options_.tolerance, false) >= kStands) continue;
      for (const std::size_t i : thing.members) moves[i] = 1;
    }
    for (std::size_t i = 0; i < observations_.size(); ++i) {
      if (moves[i] != 0 || !(relative_error(T_c_w, observations_[i]) <= factor * factor)) continue;
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

  /// chi2 over its bound; infinite behind the camera.
  [[nodiscard]] double relative_error(const Rigid3& T_c_w, const PoseObservation& o) const {
    const Eigen::Vector3d p_c = T_c_w * o.p_w;
    if (!(p_c.z() >= kMinDepth)) return std::numeric_limits<double>::infinity();
    const Eigen::Vector3d pixel = camera_.project_stereo(p_c);
    const double du = pixel.x() - o.u;
    const double dv = pixel.y() - o.v;
    double error = du * du + dv * dv;
    const bool stereo = !std::isnan(o.u_right);
    if (stereo) {
      const double dd = (pixel.x() - pixel.z()) - (o.u - o.u_right);
      error += dd * dd;
    }
    return error * o.inv_sigma * o.inv_sigma / (stereo ? pose_.chi2_stereo : pose_.chi2_mono);
  }

  /// The few samples with most support, best first.
  [[nodiscard]] std::vector<Rival> best_samples(const Rigid3& T_c_w_votes) const {
    std::vector<Rival> best;
    std::array<CellMembers, 2> cells;
    cells[1] = unexplained(T_c_w_votes, false);
    cells[0] = scene_.things().empty() ? cells[1] : unexplained(T_c_w_votes, true);
    std::mt19937_64 random(options_.seed);
    for (int k = 0; k < options_.samples; ++k) {
      const CellMembers& from = cells[static_cast<std::size_t>(k) % cells.size()];
      if (from.size() < kSample) continue;
      const std::optional<Rigid3> T_c_w = sample_pose(from, random);
      if (!T_c_w) continue;
      const Rival rival = judged(*T_c_w, options_.reach);
      const auto place = std::find_if(best.begin(), best.end(), [&](const Rival& other) {
        return rival.support > other.support;
      });
      best.insert(place, rival);
      if (best.size() > kRefined) best.pop_back();
    }
    return best;
  }

  /// Stereo observations out of reach of a pose, by cell; those of the fixed scene or all.
  [[nodiscard]] CellMembers unexplained(const Rigid3& T_c_w, bool fixed) const {
    CellMembers cells;
    for (const auto& members : scene_.members()) {
      std::vector<std::size_t> rest;
      for (const std::size_t i : members) {
        const PoseObservation& o = observations_[i];
        if (fixed && scene_.share(i) == 0) continue;
        const bool explained = relative_error(T_c_w, o) <= options_.reach * options_.reach;
        if (!explained && o.u - o.u_right > 0) rest.push_back(i);
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

  const StereoCamera& camera_;
  std::span<const PoseObservation> observations_;
  std::optional<ExpectedPose> expected_;
  const ConsensusOptions& options_;
  const PoseOptions& pose_;
  SceneCells scene_;
};

}  // namespace

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
    Rival best = consensus.refined(T_c_w_initial);
    const Rival rival = consensus.best_rival(best.T_c_w, best.T_c_w);
    if (rival.support > options.margin * best.support) best = rival;
    result.pose = consensus.final_pose(best);
    result.contested = result.overruled = true;
    return result;
  }
  const std::optional<Rival> scene = consensus.fixed_scene(result.pose.T_c_w);
  const double explained = consensus.fixed_support(result.pose.T_c_w, options.clear, false);
  result.contested = consensus.area() == 0 ||  // nothing but things that can move
                     explained < (1 - options.contested) * consensus.area();
  if (!scene && !result.contested) return result;
  const double wanted =
      options.margin * consensus.judged(result.pose.T_c_w, options.tolerance).support;
  Rival best{result.pose.T_c_w, wanted};
  if (scene && scene->support > wanted + 1) best = *scene;
  if (result.contested) {
    const Rival rival = consensus.best_rival(result.pose.T_c_w, T_c_w_initial);
    if (rival.support > best.support) best = rival;
  }
  if (best.support <= wanted) return result;
  result.overruled = true;
  result.pose = consensus.final_pose(best);
  return result;
}

}  // namespace kys_slam
