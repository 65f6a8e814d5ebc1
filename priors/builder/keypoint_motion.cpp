// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/keypoint_motion.h"

#include <kys_slam/util/median.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "features/orb_extractor.h"
#include "matching/landmark_search.h"
#include "matching/stereo_matcher.h"
#include "motion/follow_back.h"
#include "optimization/pose_optimization.h"

namespace kys_slam {
namespace {

constexpr double kNearRadius = 20;        // px at octave 0, around where the last motion puts it
constexpr double kWideRadius = 80;        // px, when that does not lead anywhere
constexpr int kFewMatches = 40;           // below this the wider search is tried
constexpr int kFewestInliers = 15;        // below this the camera's motion is not known
constexpr double kPointShare = 0.5;       // of a point's information: it has noise in both frames
constexpr double kSearchRadius = 4;       // px at octave 0, around a prediction
constexpr double kMaxSearch = 80;         // px, in which a thing of unknown motion is searched
constexpr double kSameShift = 0.35;       // m, between keypoints of one thing; and
constexpr double kSameShiftDepth = 0.02;  // of their depth
constexpr double kKeptShare = 0.6;  // of the matches to the next frame that a longer span keeps

OrbOptions orb_options(const BuilderOptions::Keypoints& options) {
  OrbOptions orb;
  orb.features = options.features;
  return orb;
}

/// The thing segment at a pixel; 0: none.
std::uint16_t segment_at(const CameraSegments& camera, float u, float v) {
  const ImageOf<std::uint16_t>& map = camera.panoptic->map;
  const auto x = static_cast<int>(std::floor(u + 0.5F)), y = static_cast<int>(std::floor(v + 0.5F));
  if (x < 0 || y < 0 || x >= map.width() || y >= map.height()) return 0;
  return map.at(x, y);
}

/// Of the shifts of a thing's keypoints the one that most others agree with.
std::optional<Eigen::Vector3d> common_shift(
    const std::vector<std::pair<Eigen::Vector3d, double>>& shifts) {
  std::size_t best = 0, votes = 0;
  for (std::size_t i = 0; i < shifts.size(); ++i) {
    std::size_t count = 0;
    for (const auto& [shift, depth] : shifts) {
      const double tolerance = kSameShift + kSameShiftDepth * depth;
      count += (shift - shifts[i].first).norm() < tolerance ? 1 : 0;
    }
    if (count > votes) {
      votes = count;
      best = i;
    }
  }
  if (votes < 3) return std::nullopt;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& [shift, depth] : shifts) {
    const double tolerance = kSameShift + kSameShiftDepth * depth;
    if ((shift - shifts[best].first).norm() < tolerance) sum += shift;
  }
  return Eigen::Vector3d(sum / static_cast<double>(votes));
}

}  // namespace

KeypointMotion::KeypointMotion(const StereoCamera& camera, const BuilderOptions::Keypoints& options)
    : camera_(camera), scales_(OrbOptions{}.scale_factor, OrbOptions{}.levels), options_(options) {}

std::shared_ptr<const FrameFeatures> KeypointMotion::extract(const GrayImage& left,
                                                             const GrayImage& right) const {
  // The extractor keeps pyramid and buffers, the matcher reads the pyramids.
  std::array<OrbExtractor, 2> extractors = {OrbExtractor(orb_options(options_)),
                                            OrbExtractor(orb_options(options_))};
  std::array<FeatureSet, 2> features;
  extractors[0].extract(left, features[0]);
  extractors[1].extract(right, features[1]);
  kys::Statistics statistics;
  RightPositions columns = match_stereo(
      camera_, scales_, {&features[0], {}, &extractors[0].pyramid()},
      {&features[1], {}, &extractors[1].pyramid()}, StereoOptions{}, model_, statistics);
  return std::make_shared<const FrameFeatures>(camera_, std::move(features[0]), std::move(columns),
                                               std::vector<kys::Prior>{});
}

KeypointMotion::Frame KeypointMotion::make_frame(double timestamp,
                                                 std::shared_ptr<const FrameFeatures> features,
                                                 std::span<const CameraSegments> cameras) const {
  Frame frame;
  frame.timestamp = timestamp;
  frame.features = std::move(features);
  const FrameFeatures& f = *frame.features;
  frame.back.assign(f.size(), -1);
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    frame.things[c].push_back(false);
    for (const InputSegment& s : cameras[c].panoptic->segments) {
      frame.things[c].push_back(s.thing);
    }
    frame.segments[c].assign(f.size(), 0);
    for (std::size_t i = 0; i < f.size(); ++i) {
      if (!f.has_stereo(i)) continue;
      const float u = c == 0 ? f.keypoint(i).x : f.u_right(i);
      frame.segments[c][i] = segment_at(cameras[c], u, f.keypoint(i).y);
    }
  }
  return frame;
}

bool KeypointMotion::on_thing(const Frame& frame, std::size_t i) const {
  for (std::size_t c = 0; c < 2; ++c) {
    if (!frame.segments[c].empty() && frame.things[c][frame.segments[c][i]]) return true;
  }
  return false;
}

/// Camera motion since the last frame from its stereo keypoints on stuff.
std::optional<KeypointMotion::Step> KeypointMotion::camera_step(const Frame& now,
                                                                const Rigid3& expected,
                                                                double radius) const {
  const Frame& last = frames_.front();
  const FrameFeatures& before = *last.features;
  std::vector<SearchQuery> queries;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!before.has_stereo(i) || on_thing(last, i)) continue;
    const Keypoint& seen = before.keypoint(i);
    const Eigen::Vector3d point = camera_.back_project(seen.x, seen.y, before.depth(i));
    const Eigen::Vector3d p = expected * point;
    if (p.z() <= 0.1) continue;
    const Eigen::Vector3d pixel = camera_.project_stereo(p);
    SearchQuery query = query_for_feature(before, i, pixel, scales_);
    query.u_right = std::numeric_limits<float>::quiet_NaN();
    query.radius = static_cast<float>(radius * scales_.scale[seen.octave]);
    queries.push_back(query);
    points.push_back(point);
  }
  SearchOptions options;
  options.max_distance = 60;
  options.ratio = 0.85F;
  options.check_rotation = true;
  kys::Statistics statistics;
  const std::vector<SearchMatch> matches =
      search_features(*now.features, scales_, queries, options, model_, statistics);
  std::vector<PoseObservation> observations;
  for (std::size_t q = 0; q < matches.size(); ++q) {
    if (matches[q].feature < 0) continue;
    const auto i = static_cast<std::size_t>(matches[q].feature);
    const StereoPixel pixel = now.features->stereo_pixel(i, scales_);
    observations.push_back({points[q], pixel.u, pixel.v, pixel.u_right, pixel.inv_sigma,
                            static_cast<float>(kPointShare)});
  }
  const PoseResult pose = optimize_pose(camera_, expected, observations);
  if (pose.inliers < kFewestInliers) return std::nullopt;
  return Step{pose.T_c_w, pose.information.ldlt().solve(Matrix6d::Identity()),
              static_cast<std::size_t>(pose.inliers)};
}

std::optional<KeypointMotion::Step> KeypointMotion::camera_step(const Frame& now) const {
  std::optional<Step> best = camera_step(now, T_now_last_, kNearRadius);
  if (best && best->inliers >= static_cast<std::size_t>(kFewMatches)) return best;
  for (const Rigid3& start : {T_now_last_, Rigid3{}}) {
    std::optional<Step> other = camera_step(now, start, kWideRadius);
    if (other && (!best || other->inliers > best->inliers)) best = std::move(other);
  }
  return best;
}

/// Keypoints of the last frame's things in this one, near where `shifts` put them.
std::vector<SearchMatch> KeypointMotion::search(const Frame& now,
                                                const std::vector<Candidate>& candidates,
                                                const std::vector<Eigen::Vector3d>& shifts,
                                                bool wide) const {
  const FrameFeatures& before = *frames_.front().features;
  const double dt = now.timestamp - frames_.front().timestamp;
  std::vector<SearchQuery> queries;
  for (std::size_t n = 0; n < candidates.size(); ++n) {
    const std::size_t i = candidates[n].keypoint;
    const Eigen::Vector3d p = candidates[n].still + shifts[n];
    const Keypoint& seen = before.keypoint(i);
    const double z = std::max(p.z(), 0.1);
    const Eigen::Vector3d pixel = camera_.project_stereo({p.x(), p.y(), z});
    SearchQuery query = query_for_feature(before, i, pixel, scales_);
    const double radius = kSearchRadius * scales_.scale[seen.octave];
    query.radius = static_cast<float>(
        wide ? std::min(radius + camera_.fx * options_.max_speed * dt / z, kMaxSearch) : radius);
    queries.push_back(query);
  }
  std::vector<std::uint8_t> flat(now.features->size());
  for (std::size_t i = 0; i < flat.size(); ++i) flat[i] = now.features->has_stereo(i) ? 0 : 1;
  SearchOptions options;
  options.max_distance = 80;
  options.ratio = wide ? 0.85F : 0.95F;
  options.check_rotation = wide;
  options.taken = flat;
  options.context = kys::Context::kInstance;
  kys::Statistics statistics;
  return search_features(*now.features, scales_, queries, options, model_, statistics);
}

/// Links keypoints of things to the last frame. Each is searched where it is if it stands still,
/// and where it is if it moves as most of its thing's keypoints do; those are found by a search
/// around all places it can have gone to.
void KeypointMotion::follow(Frame& now) const {
  const Frame& last = frames_.front();
  const FrameFeatures& before = *last.features;
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!before.has_stereo(i) || !on_thing(last, i)) continue;
    const Keypoint& seen = before.keypoint(i);
    const Eigen::Vector3d p = T_now_last_ * camera_.back_project(seen.x, seen.y, before.depth(i));
    if (p.z() > 0.1) candidates.push_back({i, p});
  }
  if (candidates.empty()) return;
  std::vector<Eigen::Vector3d> shifts(candidates.size(), Eigen::Vector3d::Zero());
  std::vector<SearchMatch> best = search(now, candidates, shifts, false);
  const std::vector<SearchMatch> wide = search(now, candidates, shifts, true);
  std::array<std::map<std::uint16_t, std::vector<std::size_t>>, 2> members;
  for (std::size_t n = 0; n < candidates.size(); ++n) {
    for (std::size_t c = 0; c < 2; ++c) {
      if (last.segments[c].empty()) continue;
      const std::uint16_t k = last.segments[c][candidates[n].keypoint];
      if (last.things[c][k]) members[c][k].push_back(n);
    }
  }
  const auto take = [&](const std::vector<SearchMatch>& found) {
    for (std::size_t n = 0; n < found.size(); ++n) {
      if (found[n].feature < 0) continue;
      if (best[n].feature < 0 || found[n].distance < best[n].distance) best[n] = found[n];
    }
  };
  for (std::size_t c = 0; c < 2; ++c) {
    bool any = false;
    std::fill(shifts.begin(), shifts.end(), Eigen::Vector3d::Zero());
    for (const auto& [k, indices] : members[c]) {
      std::vector<std::pair<Eigen::Vector3d, double>> seen;
      for (const std::size_t n : indices) {
        if (wide[n].feature < 0) continue;
        const auto i = static_cast<std::size_t>(wide[n].feature);
        const Keypoint& k2 = now.features->keypoint(i);
        const Eigen::Vector3d p = camera_.back_project(k2.x, k2.y, now.features->depth(i));
        seen.emplace_back(p - candidates[n].still, p.z());
      }
      const std::optional<Eigen::Vector3d> shift = common_shift(seen);
      if (!shift) continue;
      any = true;
      for (const std::size_t n : indices) shifts[n] = *shift;
    }
    if (any) take(search(now, candidates, shifts, false));
  }
  std::vector<float> distance(now.back.size(), std::numeric_limits<float>::infinity());
  for (std::size_t n = 0; n < best.size(); ++n) {
    if (best[n].feature < 0) continue;
    const auto i = static_cast<std::size_t>(best[n].feature);
    if (best[n].distance >= distance[i]) continue;
    distance[i] = best[n].distance;
    now.back[i] = static_cast<std::int32_t>(candidates[n].keypoint);
  }
}

/// Which segments of the last frame and of this one, and of both cameras, share keypoints.
void KeypointMotion::link(const Frame& now, SegmentLinks& links) const {
  const auto column = [](const Frame& frame, std::size_t c, std::size_t i) {
    return c == 0 ? frame.features->keypoint(i).x : frame.features->u_right(i);
  };
  for (std::size_t i = 0; i < now.back.size(); ++i) {
    if (!now.features->has_stereo(i) || now.segments[0].empty() || now.segments[1].empty())
      continue;
    const std::uint16_t left = now.segments[0][i], right = now.segments[1][i];
    if (now.things[0][left] && now.things[1][right]) ++links.in_stereo[{left, right}];
  }
  if (frames_.empty()) return;
  const Frame& last = frames_.front();
  for (std::size_t c = 0; c < 2; ++c) {
    if (now.segments[c].empty()) continue;
    std::map<std::uint16_t, std::pair<std::vector<float>, std::vector<float>>> moved;
    for (std::size_t i = 0; i < now.back.size(); ++i) {
      if (now.back[i] < 0) continue;
      const auto then = static_cast<std::size_t>(now.back[i]);
      const std::uint16_t from = last.segments[c][then], to = now.segments[c][i];
      if (!last.things[c][from]) continue;
      moved[from].first.push_back(column(now, c, i) - column(last, c, then));
      moved[from].second.push_back(now.features->keypoint(i).y - last.features->keypoint(then).y);
      if (now.things[c][to]) ++links.in_time[c][{from, to}];
    }
    for (auto& [segment, shift] : moved) {
      const auto count = static_cast<int>(shift.first.size());
      links.shifts[c][segment] = {median(shift.first), median(shift.second), count};
    }
  }
}

/// Errors that all keypoints of a thing share (rectification, distortion, synchronisation) do not
/// become smaller with their number: across the line of sight, and along it by the disparity's.
void KeypointMotion::add_common_error(const std::vector<InstanceMatch>& matches,
                                      CameraMotion& ego) const {
  std::vector<double> z, x, y;
  for (const InstanceMatch& match : matches) {
    const StereoPixel& p = match.now;
    z.push_back(camera_.bf() / std::max(0.5, static_cast<double>(p.u) - p.u_right));
    x.push_back((p.u - camera_.cx) / camera_.fx);
    y.push_back((p.v - camera_.cy) / camera_.fy);
  }
  const double depth = median(z);
  const Eigen::Vector3d ray(median(x), median(y), 1);
  const double across = options_.common_error * depth / camera_.fx;
  const double along = options_.common_disparity_error * depth * depth / camera_.bf();
  ego.covariance.bottomRightCorner<3, 3>() +=
      across * across * Eigen::Matrix3d::Identity() + along * along * ray * ray.transpose();
}

/// A segment of the last frame: its keypoints now against as many frames back as most of them can
/// be followed.
KeypointEvidence KeypointMotion::judge(const Frame& now, std::size_t c,
                                       std::uint16_t segment) const {
  KeypointEvidence evidence;
  std::vector<std::size_t> keypoints;
  for (std::size_t i = 0; i < now.back.size(); ++i) {
    const std::int32_t at = now.back[i];
    if (at >= 0 && frames_[0].segments[c][static_cast<std::size_t>(at)] == segment) {
      keypoints.push_back(i);
    }
  }
  const Followed followed = follow_back(keypoints, now, frames_, test_.min_matches, kKeptShare);
  const std::size_t span = followed.frames;
  if (span == 0) return evidence;
  const Frame& before = frames_[span - 1];
  std::vector<InstanceMatch> matches =
      matches_of(followed, *before.features, *now.features, scales_);
  const double dt = now.timestamp - before.timestamp;
  const MotionRange range{0.5 * options_.max_speed * dt, 0.25 * dt};
  CameraMotion ego = camera_motion(before.T_c_w, PoseIncrement{}, now.T_c_w, now.error);
  add_common_error(matches, ego);
  for (std::size_t s = 0; s + 1 < span; ++s) ego.covariance += frames_[s].error.covariance;
  const InstanceMotion motion = estimate_instance_motion(camera_, matches, ego, range, test_);
  if (motion.matches < test_.min_matches) return evidence;
  evidence.matches = motion.matches;
  evidence.inliers = motion.inliers;
  evidence.log_ratio = motion.log_ratio / static_cast<double>(span);
  evidence.span = dt;
  const Eigen::Vector3d shift = motion.motion.tail<3>(), ray = motion.centre.normalized();
  evidence.shift = shift.norm();
  evidence.velocity = shift / dt;
  const Eigen::Matrix3d covariance = motion.covariance.bottomRightCorner<3, 3>();
  evidence.velocity_sigma =
      std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly)
                    .eigenvalues()
                    .maxCoeff()) /
      dt;
  evidence.pixels = camera_.fx * (shift - ray * ray.dot(shift)).norm() / motion.centre.z();
  return evidence;
}

KeypointMotion::Evidence KeypointMotion::next_frame(double timestamp,
                                                    std::shared_ptr<const FrameFeatures> features,
                                                    std::span<const CameraSegments> cameras,
                                                    SegmentLinks& links) {
  Frame now = make_frame(timestamp, std::move(features), cameras);
  Evidence evidence;
  if (!frames_.empty()) {
    for (std::size_t c = 0; c < cameras.size(); ++c) {
      evidence.emplace_back(frames_.front().things[c].size() - 1);
    }
    if (const std::optional<Step> step = camera_step(now)) {
      T_now_last_ = step->T_now_last;
      now.T_c_w = T_now_last_ * frames_.front().T_c_w;
      now.error.covariance = step->covariance;
      follow(now);
      for (std::size_t c = 0; c < cameras.size(); ++c) {
        for (std::size_t k = 1; k < frames_.front().things[c].size(); ++k) {
          if (!frames_.front().things[c][k]) continue;
          evidence[c][k - 1] = judge(now, c, static_cast<std::uint16_t>(k));
        }
      }
    } else {
      frames_.clear();
      T_now_last_ = Rigid3{};
    }
  }
  link(now, links);
  frames_.push_front(std::move(now));
  if (frames_.size() > static_cast<std::size_t>(options_.max_frames)) frames_.pop_back();
  return evidence;
}

}  // namespace kys_slam
