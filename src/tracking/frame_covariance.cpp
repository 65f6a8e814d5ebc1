// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/frame_covariance.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "geometry/chi_square.h"
#include "geometry/reprojection.h"
#include "geometry/so3.h"

namespace kys_slam {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Matrix6d = FrameCovariance::Matrix6d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Problem = PoseCovarianceProblem;

// Fitted to rendered worlds, with other seeds than those reported (docs/pose_quality.md): on the
// variance of all noise, and on its growth with the square of the step since the last frame by the
// harmonic mean of the distance. The more the view changes, the more the errors of patches on one
// surface have in common.
constexpr double kInflation = 1.1;
constexpr double kViewChange = 10;

// px, of a frame that sees nothing near: an offset of disparities counts by this one.
constexpr double kLeastDisparity = 0.5;

// Standard deviation of lengths that no image shows, a share: the baseline and the focal length.
constexpr double kScale = 0.001;

// The errors of landmarks are summed over a sample of about this many, and over their views in so
// many keyframes: it keeps the cost low.
constexpr std::size_t kSample = 100;
constexpr std::size_t kMostKeyframes = 5;

// The noise measured in a frame counts by this share; bounds of what it can be, as a variance
// relative to the assumed one.
constexpr double kNewest = 0.1;
constexpr double kLeastNoise = 0.02;
constexpr double kMostNoise = 20;

// Errors within one of so many columns of square cells are not independent.
constexpr int kColumns = 20;
constexpr double kFewestCells = 12;

/// D^T W D with the derivative D of what a camera measures by the point.
Matrix3d information_of(const StereoCamera& camera, const Vector3d& p_c, const StereoPixel& pixel) {
  const Matrix3d D = reprojection_jacobian(camera, p_c);
  const double weight = static_cast<double>(pixel.inv_sigma) * pixel.inv_sigma;
  const bool stereo = !std::isnan(pixel.u_right);
  const Vector3d weights(weight, weight * pixel.ratio.v,
                         stereo ? weight * pixel.ratio.disparity : 0);
  return D.transpose() * weights.asDiagonal() * D;
}

/// Gradient of half the chi-square by an increment of the pose.
Vector6d gradient_of(const StereoCamera& camera, const Vector3d& p_c, const StereoPixel& pixel) {
  Vector3d e = reprojection_error(camera, p_c, pixel.u, pixel.v, pixel.u_right);
  const double weight = static_cast<double>(pixel.inv_sigma) * pixel.inv_sigma;
  const bool stereo = !std::isnan(pixel.u_right);
  e = Vector3d(weight * e.x(), weight * pixel.ratio.v * e.y(),
               stereo ? weight * pixel.ratio.disparity * e.z() : 0);
  const Vector3d by_point = reprojection_jacobian(camera, p_c).transpose() * e;
  Vector6d gradient;
  gradient << p_c.cross(by_point), by_point;
  return gradient;
}

/// A relative error of lengths shows along the translation.
void add_scale_error(const Rigid3& T_c_other, double sigma, Matrix6d& covariance) {
  const Vector3d t = sigma * T_c_other.translation;
  covariance.bottomRightCorner<3, 3>() += t * t.transpose();
}

/// 1/m, mean of the inverse distances of what the frame sees.
double nearness_of(std::span<const Problem::Landmark> landmarks) {
  double sum = 0;
  for (const Problem::Landmark& l : landmarks) sum += 1 / std::max(l.p.z(), kMinDepth);
  return landmarks.empty() ? 0 : sum / static_cast<double>(landmarks.size());
}

/// All noise by the factor.
void scale_noise(double variance, Problem& problem) {
  for (Problem::View& view : problem.views) view.information /= variance;
  for (Problem::Landmark& l : problem.landmarks) l.noise *= variance;
}

}  // namespace

/// The reference, the one that the frame before became, and those that observe most landmarks.
void FrameCovariance::choose_keyframes(const Replica& replica, const Frame& frame,
                                       std::span<const LandmarkId> landmarks) {
  std::vector<KeyFrameId> found;
  for (const LandmarkId landmark : landmarks) {
    for (const KeyFrameId id : replica.landmarks().at(landmark).observers) {
      if (id.value >= count_.size()) {
        count_.resize(std::size_t{id.value} + 1, 0);
        slot_.resize(count_.size(), -1);
      }
      if (count_[id.value]++ == 0) found.push_back(id);
    }
  }
  std::erase_if(found, [&](KeyFrameId id) {
    return id == frame.reference || id == frame.before || !replica.keyframes().contains(id);
  });
  const auto is_before = [&](KeyFrameId a, KeyFrameId b) {
    if (count_[a.value] != count_[b.value]) return count_[a.value] > count_[b.value];
    return a < b;
  };
  const std::size_t most = std::min(kMostKeyframes, found.size());
  std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(most), found.end(),
                    is_before);
  found.resize(most);
  for (const LandmarkId landmark : landmarks) {
    for (const KeyFrameId id : replica.landmarks().at(landmark).observers) count_[id.value] = 0;
  }
  const auto add = [&](KeyFrameId id) {
    if (id.value >= slot_.size()) {
      count_.resize(std::size_t{id.value} + 1, 0);
      slot_.resize(count_.size(), -1);
    }
    slot_[id.value] = static_cast<std::int16_t>(keyframes_.size());
    const Rigid3 T_k_c = replica.keyframes().at(id).T_c_w * frame.T_c_w.inverse();
    keyframes_.push_back({id, T_k_c, T_k_c.R()});
  };
  for (const Keyframe& k : keyframes_) slot_[k.id.value] = -1;
  keyframes_.clear();
  add(frame.reference);
  if (frame.before.valid() && frame.before != frame.reference) add(frame.before);
  for (const KeyFrameId id : found) add(id);
}

/// Adds what the keyframes know of the landmarks in the sample, each with its own feature.
void FrameCovariance::add_views(const Replica& replica, std::span<const LandmarkId> ids,
                                Problem& problem) {
  for (std::size_t l = 0; l < ids.size(); ++l) {
    if (!(problem.landmarks[l].stands_for > 0)) continue;
    if (ids[l].value >= place_.size()) place_.resize(std::size_t{ids[l].value} + 1, -1);
    place_[ids[l].value] = static_cast<std::int32_t>(l);
  }
  std::vector<std::pair<std::size_t, Problem::View>> found;  // landmark
  for (std::size_t slot = 0; slot < keyframes_.size(); ++slot) {
    const Keyframe& k = keyframes_[slot];
    const KeyFrameView& view = replica.keyframes().at(k.id);
    for (std::size_t i = 0; i < view.landmarks.size(); ++i) {
      const std::uint32_t id = view.landmarks[i].value;
      if (id >= place_.size() || place_[id] < 0) continue;
      const auto l = static_cast<std::size_t>(place_[id]);
      const Vector3d p_k = k.T_k_c * problem.landmarks[l].p;
      if (!(p_k.z() >= kMinDepth)) continue;
      const StereoPixel pixel = view.features->stereo_pixel(i, scales_);
      const Matrix3d information = information_of(camera_, p_k, pixel);
      found.push_back({l, {static_cast<int>(slot), k.R.transpose() * information * k.R}});
      ++problem.landmarks[l].views;
    }
  }
  for (const LandmarkId id : ids) {
    if (id.value < place_.size()) place_[id.value] = -1;
  }
  std::uint32_t end = 0;
  for (Problem::Landmark& l : problem.landmarks) {
    l.first_view = end;
    end += std::exchange(l.views, 0);
  }
  problem.views.resize(end);
  for (const auto& [l, view] : found) {
    Problem::Landmark& landmark = problem.landmarks[l];
    problem.views[landmark.first_view + landmark.views++] = view;
  }
}

/// The landmarks of the frame.
void FrameCovariance::add_seen(const Replica& replica, const Frame& frame, Problem& problem) const {
  for (const Seen& seen : frame.seen) {
    Problem::Landmark& to = problem.landmarks.emplace_back();
    to.p = frame.T_c_w * replica.landmarks().at(seen.landmark).p_w;
    const Matrix3d information = information_of(camera_, to.p, seen.pixel);
    to.weight = seen.share * information;
    to.noise = seen.share * seen.share * seen.own * information;
  }
}

/// Variance of the errors in the frame by the expected one. Errors of neighbours are not
/// independent: they count together by cells of the image (a cluster-robust covariance: Liang and
/// Zeger, 1986).
double FrameCovariance::measure_noise(const Frame& frame, const Problem& problem,
                                      const PoseCovarianceResult& found) const {
  const double size = static_cast<double>(camera_.width) / kColumns;
  std::map<std::pair<int, int>, Vector6d> cells;
  for (std::size_t k = 0; k < frame.seen.size(); ++k) {
    const Seen& seen = frame.seen[k];
    if (problem.landmarks[k].weight.isZero(0)) continue;
    const std::pair cell(static_cast<int>(seen.pixel.u / size),
                         static_cast<int>(seen.pixel.v / size));
    cells.try_emplace(cell, Vector6d::Zero()).first->second +=
        seen.share * gradient_of(camera_, problem.landmarks[k].p, seen.pixel);
  }
  double measured = 0;
  for (const auto& [cell, gradient] : cells) measured += gradient.dot(found.inverse * gradient);
  const double expected = (found.inverse * found.gradient).trace();
  const auto count = static_cast<double>(cells.size());
  if (!(expected > 0) || count < kFewestCells) return 1;
  return measured / expected * count / (count - 6);  // six were fitted
}

/// Adds what the frame before saw, and to `ids` the landmarks that only it sees.
void FrameCovariance::add_before(const Replica& replica, const Frame& frame,
                                 std::vector<LandmarkId>& ids, Problem& problem) const {
  std::vector<std::pair<LandmarkId, std::size_t>> here;
  for (std::size_t k = 0; k < ids.size(); ++k) here.emplace_back(ids[k], k);
  std::sort(here.begin(), here.end());
  const Rigid3 T_b_c = frame.T_before_w * frame.T_c_w.inverse();
  const Matrix3d R = T_b_c.R();
  for (const Weight& w : before_->weights) {
    const LandmarkId id = replica.resolve(w.landmark);
    const LandmarkView* landmark = replica.landmarks().find(id);
    if (landmark == nullptr) continue;
    const Matrix3d weight = R.transpose() * w.weight * R;
    const auto at = std::lower_bound(here.begin(), here.end(), std::pair{id, std::size_t{0}});
    if (at != here.end() && at->first == id) {
      problem.landmarks[at->second].weight_before = weight;
      continue;
    }
    Problem::Landmark& added = problem.landmarks.emplace_back();
    added.p = frame.T_c_w * landmark->p_w;
    added.weight_before = weight;
    ids.push_back(id);
  }
  const Matrix6d change = adjoint(T_b_c);
  problem.before = Problem::Before{.noise = change.transpose() * before_->noise * change,
                                   .prior = change.transpose() * before_->prior * change};
}

FrameCovariance::Result FrameCovariance::update(const Replica& replica, const Frame& frame) {
  Problem problem;
  add_seen(replica, frame, problem);
  std::vector<LandmarkId> ids;
  for (const Seen& seen : frame.seen) ids.push_back(seen.landmark);
  if (before_ && !frame.before.valid()) add_before(replica, frame, ids, problem);
  const std::size_t stride = 1 + frame.seen.size() / kSample;
  for (std::size_t l = 0; l < ids.size(); ++l) {
    problem.landmarks[l].stands_for = l % stride == 0 ? static_cast<double>(stride) : 0;
  }
  std::vector<LandmarkId> sample;
  for (std::size_t l = 0; l < ids.size(); l += stride) sample.push_back(ids[l]);
  choose_keyframes(replica, frame, sample);
  if (frame.before.valid()) {
    problem.before = Problem::Before{.keyframe = slot_[frame.before.value]};
  }
  problem.keyframes = static_cast<int>(keyframes_.size());
  problem.accepted = 1 / kChi2Stereo95;
  add_views(replica, ids, problem);
  for (Problem::Landmark& l : problem.landmarks) {
    if (l.views == 0 && l.stands_for > 0) l = Problem::Landmark{.p = l.p};  // no error is known
  }
  const std::span<const Problem::Landmark> seen(problem.landmarks.data(), frame.seen.size());
  const double nearness = nearness_of(seen);
  const Rigid3 T_c_before = frame.T_c_w * frame.T_before_w.inverse();
  const double change = problem.before ? kViewChange * nearness * T_c_before.translation.norm() : 0;
  const double variance = kInflation * (1 + change * change) * noise_;
  scale_noise(variance, problem);
  if (frame.held) {
    problem.prior.diagonal() =
        left_information(frame.held->sigma_rotation, frame.held->sigma_position);
    problem.prior_error.diagonal() = problem.prior.diagonal().cwiseInverse();
    if (before_ && before_->motion) problem.prior_error += *before_->motion;
  }
  const PoseCovarianceResult found = pose_covariance(problem);
  const double measured = variance * measure_noise(frame, problem, found);
  const double share = std::max(kNewest, 1.0 / ++frames_);
  noise_ += share * (std::clamp(measured, kLeastNoise, kMostNoise) - noise_);
  Result result{found.pose, found.motion};
  // Of three numbers: products and a square root, the same on every machine.
  const double scale =
      std::hypot(kScale, rig_.focal, rig_.offset / (camera_.bf() * nearness + kLeastDisparity));
  const Rigid3& T_r_w = replica.keyframes().at(frame.reference).T_c_w;
  add_scale_error(frame.T_c_w * T_r_w.inverse(), scale, result.pose);
  if (result.motion) add_scale_error(T_c_before, scale, *result.motion);
  Before& next = before_.emplace();
  for (std::size_t k = 0; k < frame.seen.size(); ++k) {
    next.weights.push_back({frame.seen[k].landmark, problem.landmarks[k].weight});
  }
  next.noise = found.noise;
  next.prior = problem.prior;
  next.motion = result.motion;
  return result;
}

}  // namespace kys_slam
