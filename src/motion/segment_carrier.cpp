// SPDX-License-Identifier: BSD-3-Clause
#include "motion/segment_carrier.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

namespace kys_slam {

namespace {

constexpr double kFar = 1000;               // m, of features without a disparity
constexpr double kSurfaceTolerance = 0.25;  // of the disparity: still the same surface
constexpr double kLeastTolerance = 1.5;     // px
constexpr double kSurfaceRadius = 0.03;     // of the width: features that say how far a pixel is
constexpr double kNeighbourRadius = 0.01;   // of the width: features that share a segment
constexpr double kMoved = 0.02;             // m; less is no motion
constexpr double kNearest = 0.1;            // m
constexpr int kOctaves = 255;
constexpr std::size_t kSamples = 200;  // pixels of a segment, at most
constexpr double kOverlap = 0.3;       // share of the samples that name a segment
constexpr int kLeastVotes = 3;

double tolerance(double disparity) {
  return std::max(kLeastTolerance, kSurfaceTolerance * disparity);
}

double disparity_of(const FrameFeatures& features, std::size_t i) {
  return features.keypoint(i).x - features.u_right(i);
}

}  // namespace

SegmentCarrier::SegmentCarrier(const StereoCamera& camera,
                               std::shared_ptr<const SegmentImage> image,
                               std::vector<kys::Prior> segments,
                               std::shared_ptr<const FrameFeatures> features,
                               std::vector<std::uint8_t> is_thing)
    : camera_(camera),
      image_(std::move(image)),
      segments_(std::move(segments)),
      features_(std::move(features)),
      is_thing_(std::move(is_thing)),
      members_(segments_.size()) {
  segment_of_feature_.resize(features_->size());
  for (std::size_t i = 0; i < features_->size(); ++i) {
    // Segments are in the image as measured, as features were found.
    const RigCorrection::Measured m = features_->measured(i);
    const std::uint16_t segment = segment_of_feature_[i] = at(m.u, m.v);
    if (segment > 0 && features_->has_stereo(i)) {
      members_[segment - 1U].push_back(static_cast<std::uint32_t>(i));
    }
  }
}

std::uint16_t SegmentCarrier::at(double u, double v) const {
  const double x = std::floor(u + 0.5), y = std::floor(v + 0.5);
  // Comparisons with NaN are false.
  if (!(x >= 0 && y >= 0 && x < image_->map.width() && y < image_->map.height())) return 0;
  return image_->map.at(static_cast<int>(x), static_cast<int>(y));
}

/// That of the nearest feature of the segment; NaN: none is near.
double SegmentCarrier::disparity_near(std::uint16_t segment, double u, double v) const {
  const double radius = kSurfaceRadius * camera_.width;
  double nearest = radius * radius;
  double disparity = std::nan("");
  features_->for_each_near(static_cast<float>(u), static_cast<float>(v),
                           static_cast<float>(radius), 0, kOctaves, [&](std::size_t i) {
                             if (segment_of_feature_[i] != segment || !features_->has_stereo(i)) {
                               return;
                             }
                             const double du = features_->keypoint(i).x - u;
                             const double dv = features_->keypoint(i).y - v;
                             const double distance = du * du + dv * dv;
                             if (distance >= nearest) return;
                             nearest = distance;
                             disparity = disparity_of(*features_, i);
                           });
  return disparity;
}

/// Whether a point seen at a pixel of the segment lies on its surface. Of stuff, which may be a
/// whole street, only what is in front of it does not.
bool SegmentCarrier::agrees(std::uint16_t segment, const Eigen::Vector3d& p_s) const {
  const Eigen::Vector3d pixel = camera_.project_stereo(p_s);
  const double disparity = pixel.x() - pixel.z();
  const double near = disparity_near(segment, pixel.x(), pixel.y());
  if (!std::isnan(near)) {
    if (std::abs(disparity - near) <= tolerance(near)) return true;
    if (!is_thing(segment)) return disparity < near;
  } else if (!is_thing(segment)) {
    return true;
  }
  const std::vector<std::uint32_t>& members = members_[segment - 1U];
  if (members.empty()) return true;
  double least = 1e300;
  double most = 0;
  for (const std::uint32_t i : members) {
    const double d = disparity_of(*features_, i);
    least = std::min(least, d - tolerance(d));
    most = std::max(most, d + tolerance(d));
  }
  return std::isnan(near) && disparity >= least && disparity <= most;
}

/// The segment of a point (m) in the camera of the picture. \param only this one; 0: any
std::uint16_t SegmentCarrier::seen_at(const Eigen::Vector3d& p_s, std::uint16_t only) const {
  if (p_s.z() < kNearest) return 0;
  const Eigen::Vector2d pixel = camera_.project(p_s);
  const std::uint16_t segment = at(pixel.x(), pixel.y());
  if (segment == 0 || (only != 0 && segment != only)) return 0;
  return agrees(segment, p_s) ? segment : std::uint16_t{0};
}

std::uint16_t SegmentCarrier::segment_of(const Eigen::Vector3d& p_now, const Rigid3& T_s_now,
                                         const SegmentShifts& shifts) const {
  const Eigen::Vector3d p_s = T_s_now * p_now;
  for (std::size_t k = 0; k < shifts.size(); ++k) {
    if (shifts[k].norm() < kMoved) continue;
    const auto segment = static_cast<std::uint16_t>(k + 1);
    if (seen_at(p_s - shifts[k], segment) != 0) return segment;
  }
  const std::uint16_t segment = seen_at(p_s, 0);
  // Where a segment was that has moved on, something else is seen now.
  return segment > 0 && shifts[segment - 1U].norm() >= kMoved ? std::uint16_t{0} : segment;
}

std::vector<std::uint16_t> SegmentCarrier::carry(const FrameFeatures& now, const Rigid3& T_s_now,
                                                 const SegmentShifts& shifts) const {
  std::vector<std::uint16_t> numbers(now.size(), 0);
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (!now.has_stereo(i)) continue;
    const Keypoint& k = now.keypoint(i);
    numbers[i] = segment_of(camera_.back_project(k.x, k.y, now.depth(i)), T_s_now, shifts);
  }
  // Without a disparity: that of the nearest feature with one, else as far away.
  const auto radius = static_cast<float>(kNeighbourRadius * camera_.width);
  std::vector<std::uint16_t> others(now.size(), 0);
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (now.has_stereo(i)) continue;
    const Keypoint& k = now.keypoint(i);
    float nearest = radius * radius;
    bool found = false;
    now.for_each_near(k.x, k.y, radius, 0, kOctaves, [&](std::size_t n) {
      if (!now.has_stereo(n)) return;
      const float du = now.keypoint(n).x - k.x, dv = now.keypoint(n).y - k.y;
      if (du * du + dv * dv >= nearest) return;
      nearest = du * du + dv * dv;
      others[i] = numbers[n];
      found = true;
    });
    if (!found) others[i] = segment_of(camera_.back_project(k.x, k.y, kFar), T_s_now, shifts);
  }
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (!now.has_stereo(i)) numbers[i] = others[i];
  }
  return numbers;
}

std::vector<kys::Prior> SegmentCarrier::priors_of(std::span<const std::uint16_t> numbers) const {
  std::vector<kys::Prior> priors(numbers.size());
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (numbers[i] > 0) priors[i] = segments_[numbers[i] - 1U];
  }
  return priors;
}

std::vector<Eigen::Vector3d> SegmentCarrier::sample(std::uint16_t segment) const {
  const std::vector<std::uint32_t>& members = members_[segment - 1U];
  if (members.empty()) return {};
  int top = image_->map.height(), bottom = -1;
  std::size_t area = 0;
  for (int y = 0; y < image_->map.height(); ++y) {
    const std::uint16_t* row = image_->map.row(y);
    const auto count = std::count(row, row + image_->map.width(), segment);
    if (count == 0) continue;
    area += static_cast<std::size_t>(count);
    top = std::min(top, y);
    bottom = y;
  }
  const int step = std::max(1, static_cast<int>(std::ceil(
                                   std::sqrt(static_cast<double>(area) / double{kSamples}))));
  std::vector<Eigen::Vector3d> points;
  for (int y = top; y <= bottom; y += step) {
    const std::uint16_t* row = image_->map.row(y);
    for (int x = 0; x < image_->map.width(); x += step) {
      if (row[x] != segment) continue;
      double nearest = 1e300;
      double depth = kFar;
      for (const std::uint32_t i : members) {
        const double du = features_->keypoint(i).x - x, dv = features_->keypoint(i).y - y;
        if (du * du + dv * dv >= nearest) continue;
        nearest = du * du + dv * dv;
        depth = features_->depth(i);
      }
      points.push_back(camera_.back_project(x, y, depth));
    }
  }
  return points;
}

std::vector<std::uint16_t> same_segments(const SegmentCarrier& before, const SegmentCarrier& now,
                                         const Rigid3& T_before_now, const SegmentShifts& shifts,
                                         const kys::InitialBelief& start) {
  struct Pair {
    int votes;
    std::uint16_t now, before;
  };
  const auto pooled = [&](std::uint16_t label) {
    return start.mobility(label) == kys::Mobility::kMobile;
  };
  std::vector<Pair> pairs;
  for (std::size_t k = 0; k < now.segments().size(); ++k) {
    const auto segment = static_cast<std::uint16_t>(k + 1);
    if (!now.is_thing(segment)) continue;
    const std::uint16_t label = now.segments()[k].label;
    const std::vector<Eigen::Vector3d> points = now.sample(segment);
    std::map<std::uint16_t, int> votes;
    for (const Eigen::Vector3d& p : points) {
      const std::uint16_t old = before.segment_of(p, T_before_now, shifts);
      if (old == 0 || !before.is_thing(old)) continue;
      const std::uint16_t old_label = before.segments()[old - 1U].label;
      if (old_label == label || (pooled(label) && pooled(old_label))) ++votes[old];
    }
    const double enough = std::max<double>(kLeastVotes, kOverlap * static_cast<double>(points.size()));
    for (const auto& [old, count] : votes) {
      if (count >= enough) pairs.push_back({count, segment, old});
    }
  }
  std::ranges::sort(pairs, [](const Pair& a, const Pair& b) {
    return std::tuple(-a.votes, a.now, a.before) < std::tuple(-b.votes, b.now, b.before);
  });
  std::vector<std::uint16_t> same(now.segments().size(), 0);
  std::vector<std::uint8_t> taken(before.segments().size() + 1, 0);
  for (const Pair& pair : pairs) {
    if (same[pair.now - 1U] != 0 || taken[pair.before] != 0) continue;
    same[pair.now - 1U] = pair.before;
    taken[pair.before] = 1;
  }
  return same;
}

}  // namespace kys_slam
