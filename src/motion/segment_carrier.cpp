// SPDX-License-Identifier: BSD-3-Clause
#include "motion/segment_carrier.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "motion/segment_carrying.h"

namespace kys_slam {

namespace {

constexpr double kSlant = 0.35;        // px of disparity per px: a road, steep surfaces
constexpr double kMoved = 0.02;        // m; less is no motion
constexpr std::size_t kSamples = 200;  // pixels of a segment, at most
constexpr int kFillSteps = 3;          // a segment goes on beside what the step before gave
constexpr int kLeastAlike = 3;         // features of a segment beside another that is taken for it
constexpr double kMostAlike = 0.7;     // of the features around

}  // namespace

SegmentCarrier::SegmentCarrier(const StereoCamera& camera,
                               std::shared_ptr<const SegmentImage> image,
                               std::vector<kys::Prior> segments,
                               std::shared_ptr<const FrameFeatures> features,
                               std::vector<std::uint8_t> is_thing, bool carried)
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
  if (carried) sample_depths();
}

std::uint16_t SegmentCarrier::at(double u, double v) const {
  const double x = std::floor(u + 0.5), y = std::floor(v + 0.5);
  // Comparisons with NaN are false.
  if (!(x >= 0 && y >= 0 && x < image_->map.width() && y < image_->map.height())) return 0;
  return image_->map.at(static_cast<int>(x), static_cast<int>(y));
}

/// What features of the segment around a pixel (u, v, u_right) say of how far away it is. Surfaces
/// are slanted: the further a feature, the more its disparity may differ.
SegmentCarrier::Surface SegmentCarrier::surface_at(std::uint16_t segment,
                                                   const Eigen::Vector3d& pixel) const {
  const auto radius = static_cast<float>(carrying::kSurfaceRadius * camera_.width);
  const double disparity = pixel.x() - pixel.z();
  Surface surface;
  features_->for_each_near(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), radius, 0,
                           carrying::kOctaves, [&](std::size_t i) {
                             if (segment_of_feature_[i] != segment || !features_->has_stereo(i))
                               return;
                             const double there = carrying::disparity_of(*features_, i);
                             const double distance =
                                 kys::portable::hypot(features_->keypoint(i).x - pixel.x(),
                                                      features_->keypoint(i).y - pixel.y());
                             const double margin = carrying::tolerance(there) + kSlant * distance;
                             surface.near = true;
                             if (std::abs(disparity - there) <= margin) surface.agrees = true;
                             if (disparity <= there + margin) surface.in_front = false;
                           });
  return surface;
}

/// Whether a point seen at a pixel of the segment lies on its surface. Of stuff, which may be a
/// whole street, only what is in front of it does not.
bool SegmentCarrier::agrees(std::uint16_t segment, const Eigen::Vector3d& p_s) const {
  const Eigen::Vector3d pixel = camera_.project_stereo(p_s);
  const Surface surface = surface_at(segment, pixel);
  if (surface.near) return surface.agrees || (!is_thing(segment) && !surface.in_front);
  if (!is_thing(segment)) return true;
  const std::vector<std::uint32_t>& members = members_[segment - 1U];
  if (members.empty()) return true;
  const double disparity = pixel.x() - pixel.z();
  double least = 1e300;
  double most = 0;
  for (const std::uint32_t i : members) {
    const double d = carrying::disparity_of(*features_, i);
    least = std::min(least, d - carrying::tolerance(d));
    most = std::max(most, d + carrying::tolerance(d));
  }
  return disparity >= least && disparity <= most;
}

/// The segment of a point (m) in the camera of the image. \param only this one; 0: any
std::uint16_t SegmentCarrier::seen_at(const Eigen::Vector3d& p_s, std::uint16_t only) const {
  if (p_s.z() < carrying::kNearest) return 0;
  const Eigen::Vector2d pixel = camera_.project(p_s);
  const std::uint16_t segment = at(pixel.x(), pixel.y());
  if (segment == 0 || (only != 0 && segment != only)) return 0;
  return agrees(segment, p_s) ? segment : std::uint16_t{0};
}

/// Moving segments come first: where a car has driven to, the image shows the road, which would
/// claim its points (README, "Segments of another frame").
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

/// The most exact source counts: the keypoint itself, found in the image; the pixel at which the
/// image shows a feature with a disparity; the cells moved to this frame, whose depth also serves
/// features without one; features beside it.
std::vector<std::uint16_t> SegmentCarrier::carry(const FrameFeatures& now, const Rigid3& T_s_now,
                                                 const SegmentShifts& shifts,
                                                 const SegmentSearch* search) const {
  std::vector<std::uint16_t> numbers(now.size(), 0);
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (!now.has_stereo(i)) continue;
    const Keypoint& k = now.keypoint(i);
    numbers[i] = segment_of(camera_.back_project(k.x, k.y, now.depth(i)), T_s_now, shifts);
  }
  const std::vector<Cell> moved = warp(T_s_now.inverse(), shifts);
  cover(now, T_s_now, shifts, moved, numbers);
  if (search != nullptr) find_again(now, T_s_now, shifts, moved, *search, numbers);
  for (int step = 0; step < kFillSteps; ++step) fill(now, numbers);
  return numbers;
}

/// Features without a segment have that of the cell over them.
void SegmentCarrier::cover(const FrameFeatures& now, const Rigid3& T_s_now,
                           const SegmentShifts& shifts, std::span<const Cell> moved,
                           std::vector<std::uint16_t>& numbers) const {
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (numbers[i] != 0) continue;
    const Keypoint& k = now.keypoint(i);
    const int column = static_cast<int>(std::floor((k.x + 0.5F) / carrying::kCell));
    const int row = static_cast<int>(std::floor((k.y + 0.5F) / carrying::kCell));
    if (column < 0 || row < 0 || column >= columns_ || row >= rows_) continue;
    const Cell& cell = moved[static_cast<std::size_t>(row * columns_ + column)];
    if (cell.segment == 0) continue;
    if (now.has_stereo(i)) {
      const double there = camera_.bf() / cell.depth;
      if (std::abs(carrying::disparity_of(now, i) - there) > 2 * carrying::tolerance(there))
        continue;
      numbers[i] = cell.segment;
      continue;
    }
    // At this depth the pixel in the image says it more exactly than the cell.
    const std::uint16_t exact =
        segment_of(camera_.back_project(k.x, k.y, cell.depth), T_s_now, shifts);
    numbers[i] = exact > 0 ? exact : cell.segment;
  }
}

/// What was hidden in the image, or outside it: stuff goes on beside the nearest feature that is as
/// far away; an instance, which has borders, only where most features around are on it.
void SegmentCarrier::fill(const FrameFeatures& now, std::vector<std::uint16_t>& numbers) const {
  const auto radius = static_cast<float>(carrying::kSurfaceRadius * camera_.width);
  const std::vector<std::uint16_t> known = numbers;
  std::vector<std::uint16_t> around;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (known[i] != 0) continue;
    const Keypoint& k = now.keypoint(i);
    const bool deep = now.has_stereo(i);
    const double disparity = deep ? carrying::disparity_of(now, i) : 0;
    const float reach = deep ? radius : radius / 2;
    float nearest = reach * reach;
    std::uint16_t beside = 0;
    around.clear();
    now.for_each_near(k.x, k.y, reach, 0, carrying::kOctaves, [&](std::size_t n) {
      if (known[n] == 0) return;
      if (deep && (!now.has_stereo(n) || std::abs(carrying::disparity_of(now, n) - disparity) >
                                             carrying::tolerance(disparity))) {
        return;
      }
      const float du = now.keypoint(n).x - k.x, dv = now.keypoint(n).y - k.y;
      const float distance = du * du + dv * dv;
      if (distance >= reach * reach) return;
      around.push_back(known[n]);
      if (distance >= nearest) return;
      nearest = distance;
      beside = known[n];
    });
    if (beside == 0) continue;
    const auto alike = std::ranges::count(around, beside);
    const bool most = alike >= kLeastAlike &&
                      static_cast<double>(alike) >= kMostAlike * static_cast<double>(around.size());
    if (most || (deep && !is_thing(beside))) numbers[i] = beside;
  }
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
  const int step = std::max(
      1, static_cast<int>(std::ceil(std::sqrt(static_cast<double>(area) / double{kSamples}))));
  std::vector<Eigen::Vector3d> points;
  for (int y = top; y <= bottom; y += step) {
    const std::uint16_t* row = image_->map.row(y);
    for (int x = 0; x < image_->map.width(); x += step) {
      if (row[x] != segment) continue;
      double nearest = 1e300;
      double depth = carrying::kFar;
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

}  // namespace kys_slam
