// SPDX-License-Identifier: BSD-3-Clause
#include "motion/segment_carrier.h"

#include <algorithm>
#include <array>
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
constexpr double kSlant = 0.35;             // px of disparity per px: a road, steep surfaces
constexpr int kCell = 4;                    // px, side
constexpr double kLargestSplat = 4;         // cells, half side
constexpr int kGap = 2;                     // cells, on each side
constexpr std::size_t kMostFar = 60;        // features beyond kSurfaceRadius that are compared
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
  const auto radius = static_cast<float>(kSurfaceRadius * camera_.width);
  const double disparity = pixel.x() - pixel.z();
  Surface surface;
  features_->for_each_near(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), radius, 0,
                           kOctaves, [&](std::size_t i) {
                             if (segment_of_feature_[i] != segment || !features_->has_stereo(i))
                               return;
                             const double there = disparity_of(*features_, i);
                             const double distance =
                                 std::hypot(features_->keypoint(i).x - pixel.x(),
                                            features_->keypoint(i).y - pixel.y());
                             const double margin = tolerance(there) + kSlant * distance;
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
    const double d = disparity_of(*features_, i);
    least = std::min(least, d - tolerance(d));
    most = std::max(most, d + tolerance(d));
  }
  return disparity >= least && disparity <= most;
}

/// How far away the cells of the picture are: by the nearest features of their segments. A thing
/// without a disparity is about as far away as what surrounds it, other segments are far.
void SegmentCarrier::sample_depths() {
  columns_ = (camera_.width + kCell - 1) / kCell;
  rows_ = (camera_.height + kCell - 1) / kCell;
  cells_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  std::vector<std::uint32_t> all;
  for (const std::vector<std::uint32_t>& members : members_) {
    all.insert(all.end(), members.begin(), members.end());
  }
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const double u = kCell * column + 0.5 * (kCell - 1), v = kCell * row + 0.5 * (kCell - 1);
      const std::uint16_t segment = at(u, v);
      if (segment == 0) continue;
      const std::vector<std::uint32_t>& own = members_[segment - 1U];
      const bool by_others = own.empty() && is_thing(segment);
      cells_[static_cast<std::size_t>(row * columns_ + column)] = {
          segment, static_cast<float>(depth_at(segment, by_others ? all : own, u, v))};
    }
  }
}

/// m; of the nearest three of some features, by the inverse square of their distance.
double SegmentCarrier::depth_at(std::uint16_t segment, std::span<const std::uint32_t> among,
                                double u, double v) const {
  std::array<std::pair<double, double>, 3> nearest;  // squared distance, disparity
  nearest.fill({1e300, 0});
  const auto see = [&](std::size_t i) {
    const double du = features_->keypoint(i).x - u, dv = features_->keypoint(i).y - v;
    const double distance = 1 + du * du + dv * dv;
    if (distance >= nearest.back().first) return;
    nearest.back() = {distance, disparity_of(*features_, i)};
    std::sort(nearest.begin(), nearest.end());
  };
  features_->for_each_near(static_cast<float>(u), static_cast<float>(v),
                           static_cast<float>(kSurfaceRadius * camera_.width), 0, kOctaves,
                           [&](std::size_t i) {
                             if (segment_of_feature_[i] == segment && features_->has_stereo(i)) {
                               see(i);
                             }
                           });
  if (nearest.front().first > 1e200) {
    const std::size_t step = 1 + among.size() / kMostFar;
    for (std::size_t k = 0; k < among.size(); k += step) see(among[k]);
  }
  double sum = 0;
  double weights = 0;
  for (const auto& [distance, disparity] : nearest) {
    sum += disparity / distance;
    weights += 1 / distance;
  }
  return sum > weights * camera_.bf() / kFar ? camera_.bf() * weights / sum : kFar;
}

/// The cells moved to another frame; where several come together the nearest one is seen.
std::vector<SegmentCarrier::Cell> SegmentCarrier::warp(const Rigid3& T_now_s,
                                                       const SegmentShifts& shifts) const {
  std::vector<Cell> moved(cells_.size());
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(row * columns_ + column)];
      if (cell.segment == 0) continue;
      const double u = kCell * column + 0.5 * (kCell - 1), v = kCell * row + 0.5 * (kCell - 1);
      const Eigen::Vector3d p =
          T_now_s * (camera_.back_project(u, v, cell.depth) + shifts[cell.segment - 1U]);
      if (p.z() < kNearest) continue;
      put(cell, p, moved);
    }
  }
  close_gaps(moved);
  return moved;
}

/// Between cells that move apart: that of the farthest of the neighbours, which the nearer ones
/// have uncovered.
void SegmentCarrier::close_gaps(std::vector<Cell>& grid) const {
  for (int pass = 0; pass < kGap; ++pass) {
    const std::vector<Cell> before = grid;
    for (int y = 1; y + 1 < rows_; ++y) {
      for (int x = 1; x + 1 < columns_; ++x) {
        const std::ptrdiff_t i = std::ptrdiff_t{y} * columns_ + x;
        Cell& cell = grid[static_cast<std::size_t>(i)];
        if (cell.segment != 0) continue;
        for (const std::ptrdiff_t step : {std::ptrdiff_t{-1}, std::ptrdiff_t{1},
                                          std::ptrdiff_t{-columns_}, std::ptrdiff_t{columns_}}) {
          const Cell& other = before[static_cast<std::size_t>(i + step)];
          if (other.segment != 0 && other.depth > cell.depth) cell = other;
        }
      }
    }
  }
}

/// Puts a cell at its point (m) in the camera of the other frame; it covers more of the grid when
/// it comes nearer.
void SegmentCarrier::put(const Cell& cell, const Eigen::Vector3d& p,
                         std::vector<Cell>& grid) const {
  const Eigen::Vector2d at = (camera_.project(p) + Eigen::Vector2d(0.5, 0.5)) / kCell;
  const double half = std::clamp(0.5 * cell.depth / p.z(), 0.5, kLargestSplat);
  if (!(at.x() + half >= 0 && at.y() + half >= 0 && at.x() - half < columns_ &&
        at.y() - half < rows_)) {
    return;
  }
  // Those whose centres it covers.
  const int first_x = std::max(0, static_cast<int>(std::ceil(at.x() - half - 0.5)));
  const int last_x = std::min(columns_ - 1, static_cast<int>(std::floor(at.x() + half - 0.5)));
  const int first_y = std::max(0, static_cast<int>(std::ceil(at.y() - half - 0.5)));
  const int last_y = std::min(rows_ - 1, static_cast<int>(std::floor(at.y() + half - 0.5)));
  for (int y = first_y; y <= last_y; ++y) {
    for (int x = first_x; x <= last_x; ++x) {
      Cell& there = grid[static_cast<std::size_t>(y * columns_ + x)];
      const auto depth = static_cast<float>(p.z());
      if (there.segment == 0 || depth < there.depth) there = {cell.segment, depth};
    }
  }
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
  const std::vector<Cell> moved = warp(T_s_now.inverse(), shifts);
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (numbers[i] != 0) continue;
    const Keypoint& k = now.keypoint(i);
    const int column = static_cast<int>(std::floor((k.x + 0.5F) / kCell));
    const int row = static_cast<int>(std::floor((k.y + 0.5F) / kCell));
    if (column < 0 || row < 0 || column >= columns_ || row >= rows_) continue;
    const Cell& cell = moved[static_cast<std::size_t>(row * columns_ + column)];
    if (cell.segment == 0) continue;
    if (now.has_stereo(i)) {
      const double there = camera_.bf() / cell.depth;
      if (std::abs(disparity_of(now, i) - there) > 2 * tolerance(there)) continue;
      numbers[i] = cell.segment;
      continue;
    }
    // At this depth the pixel in the picture says it more exactly than the cell.
    const std::uint16_t exact =
        segment_of(camera_.back_project(k.x, k.y, cell.depth), T_s_now, shifts);
    numbers[i] = exact > 0 ? exact : cell.segment;
  }
  fill(now, numbers);
  return numbers;
}

/// What was hidden in the picture, or outside it, has the segment of the nearest feature that is as
/// far away, unless this is a thing: these have borders.
void SegmentCarrier::fill(const FrameFeatures& now, std::vector<std::uint16_t>& numbers) const {
  const auto radius = static_cast<float>(kSurfaceRadius * camera_.width);
  const std::vector<std::uint16_t> known = numbers;
  for (std::size_t i = 0; i < now.size(); ++i) {
    if (known[i] != 0 || !now.has_stereo(i)) continue;
    const Keypoint& k = now.keypoint(i);
    const double disparity = disparity_of(now, i);
    float nearest = radius * radius;
    now.for_each_near(k.x, k.y, radius, 0, kOctaves, [&](std::size_t n) {
      if (known[n] == 0 || !now.has_stereo(n)) return;
      if (std::abs(disparity_of(now, n) - disparity) > tolerance(disparity)) return;
      const float du = now.keypoint(n).x - k.x, dv = now.keypoint(n).y - k.y;
      if (du * du + dv * dv >= nearest) return;
      nearest = du * du + dv * dv;
      numbers[i] = is_thing(known[n]) ? std::uint16_t{0} : known[n];
    });
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
    const double enough =
        std::max<double>(kLeastVotes, kOverlap * static_cast<double>(points.size()));
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
