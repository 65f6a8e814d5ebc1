// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/depth.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "util/lanes.h"

namespace kys_slam {
namespace {

constexpr int kReach = 2;           // px
constexpr float kDepthEdge = 1.0F;  // px of disparity; less is the surface's own slope

float bilinear(const ImageOf<float>& image, float x, float y) {
  const float fx = std::floor(x), fy = std::floor(y);
  if (!(fx >= 0 && fy >= 0 && fx < static_cast<float>(image.width()) &&
        fy < static_cast<float>(image.height()))) {
    return kNoValue;
  }
  const int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy);
  const int x1 = x0 + 1 < image.width() ? x0 + 1 : x0;
  const int y1 = y0 + 1 < image.height() ? y0 + 1 : y0;
  const float a = x - fx, b = y - fy;
  return (1 - b) * ((1 - a) * image.at(x0, y0) + a * image.at(x1, y0)) +
         b * ((1 - a) * image.at(x0, y1) + a * image.at(x1, y1));
}

/// The classes of a row, if they are known.
struct ClassRow {
  const std::uint16_t* segment = nullptr;
  const std::uint16_t* class_of = nullptr;

  [[nodiscard]] bool known() const { return segment != nullptr; }
  std::uint16_t operator[](int x) const { return class_of[segment[x]]; }
};

ClassRow row_of(const ClassImage* image, int y) {
  if (image == nullptr) return {};
  return {image->segment_map->row(y), image->class_of.data()};
}

/// A row of the right view being filled: columns 0..width-1, and space for what is read beside
/// them. kNone is farther than every surface.
class WarpedRow {
 public:
  static constexpr float kNone = -1e30F;

  explicit WarpedRow(int width)
      : width_(width),
        row_(static_cast<std::size_t>(width + 2 * kReach), kNone),
        target_(static_cast<std::size_t>(width)),
        gap_(static_cast<std::size_t>(width)) {}

  [[nodiscard]] float* data() { return row_.data() + kReach; }

  /// Pixels of the left view move to u - disparity, from left to right: of two that arrive at the
  /// same place the later one is nearer.
  void fill(const float* left, const ClassRow& left_class, const ClassRow& right_class) {
    find_targets(left);
    std::fill(row_.begin(), row_.end(), kNone);
    float* row = data();
    for (int x = 0; x < width_; ++x) {
      const int target = target_[static_cast<std::size_t>(x)];
      if (target < 0) continue;
      if (right_class.known() && left_class[x] != right_class[target]) continue;
      row[target] = left[x];
    }
  }

  /// A surface that is wider in the right view arrives with gaps of a pixel or two. What is seen
  /// through them does not belong there. Where the classes say that the surface goes on, the gap is
  /// filled from its sides.
  void close_gaps(const ClassRow& classes, float* out) {
    find_gaps(out);
    const float* row = data();
    for (int x = 0; classes.known() && x < width_; ++x) {
      if (gap_[static_cast<std::size_t>(x)] == 0) continue;
      const int left = nearer(x, -1), right = nearer(x, 1);
      const float a = row[x - left], b = row[x + right];
      const bool same_surface = classes[x] == classes[x - left] &&
                                classes[x] == classes[x + right] &&
                                std::abs(a - b) <= kDepthEdge * static_cast<float>(left + right);
      const float share = static_cast<float>(left) / static_cast<float>(left + right);
      if (same_surface) out[x] = a + share * (b - a);
    }
  }

 private:
  /// Where each pixel goes; -1: it has no disparity, or leaves the image.
  KYS_VECTOR_CLONES void find_targets(const float* __restrict left) {
    int* __restrict target = target_.data();
    const int width = width_;
    const auto largest = static_cast<float>(width);
    for (int x = 0; x < width; ++x) {
      const float place = static_cast<float>(x) - left[x] + 0.5F;
      const bool inside = left[x] > 0 && left[x] < largest && place >= 0;
      target[x] = static_cast<int>(inside ? place : -1.0F);
    }
  }

  /// Marks where a nearer surface is within reach on both sides. Nothing is seen there.
  KYS_VECTOR_CLONES void find_gaps(float* __restrict out) {
    const float* __restrict row = data();
    int* __restrict gap = gap_.data();
    const int width = width_;
    for (int x = 0; x < width; ++x) {
      const float least = row[x] + kDepthEdge;
      const bool left = (row[x - 1] > least) | (row[x - 2] > least);
      const bool right = (row[x + 1] > least) | (row[x + 2] > least);
      const bool between = left & right, nothing = between | (row[x] == kNone);
      gap[x] = between ? 1 : 0;
      out[x] = nothing ? kNoValue : row[x];
    }
  }
  static_assert(kReach == 2);

  /// How far away the nearer surface of a gap is on one side.
  [[nodiscard]] int nearer(int x, int step) {
    return data()[x + step] > data()[x] + kDepthEdge ? 1 : 2;
  }

  int width_;
  std::vector<float> row_;
  std::vector<int> target_, gap_;
};

/// The surface at the left view's right border, if it has a disparity.
struct Border {
  int x = -1;  // px, left view; -1: none
  float disparity = 0;
};

Border border_of(const float* left, int width) {
  for (int x = width - 1; x >= std::max(0, width - 1 - kReach); --x) {
    if (left[x] > 0) return {x, left[x]};
  }
  return {};
}

/// The right view sees more of the surface at the left view's right border, and nothing tells of
/// it. What lies behind is not seen there, though the left view knows it.
void clear_behind_border(const Border& border, const ClassRow& left_class,
                         const ClassRow& right_class, int width, float* row) {
  if (border.x < 0) return;
  const float end = static_cast<float>(border.x) - border.disparity + 0.5F;
  for (int x = end < 0 ? 0 : static_cast<int>(end) + 1; x < width; ++x) {
    const bool same_class = !right_class.known() || right_class[x] == left_class[border.x];
    if (same_class && row[x] < border.disparity - kDepthEdge) row[x] = WarpedRow::kNone;
  }
}

}  // namespace

ClassImage class_image(const PanopticMap& map) {
  ClassImage classes{&map.map, {0xFFFF}};
  for (const InputSegment& segment : map.segments) classes.class_of.push_back(segment.label);
  return classes;
}

ImageOf<float> warp_disparity_to_right(const ImageOf<float>& left, const ClassImage* left_classes,
                                       const ClassImage* right_classes) {
  const int width = left.width();
  const bool both = left_classes != nullptr && right_classes != nullptr;
  auto right = ImageOf<float>::for_overwrite(width, left.height());
  WarpedRow row(width);
  for (int y = 0; y < left.height(); ++y) {
    const ClassRow from = row_of(both ? left_classes : nullptr, y);
    const ClassRow to = row_of(both ? right_classes : nullptr, y);
    row.fill(left.row(y), from, to);
    clear_behind_border(border_of(left.row(y), width), from, to, width, row.data());
    row.close_gaps(to, right.row(y));
  }
  return right;
}

void check_left_right(ImageOf<float>& disparity, const ImageOf<float>& other, int sign,
                      double tolerance) {
  for (int y = 0; y < disparity.height(); ++y) {
    float* row = disparity.row(y);
    const float* there = other.row(y);
    for (int x = 0; x < disparity.width(); ++x) {
      const float target =
          std::floor(static_cast<float>(x) + static_cast<float>(sign) * row[x] + 0.5F);
      const bool inside = target >= 0 && target < static_cast<float>(disparity.width());
      if (!inside || !(std::abs(there[static_cast<int>(target)] - row[x]) <= tolerance)) {
        row[x] = kNoValue;
      }
    }
  }
}

void check_forward_backward(FlowField& forward, const FlowField& backward, double tolerance,
                            double relative) {
  for (int y = 0; y < forward.u.height(); ++y) {
    for (int x = 0; x < forward.u.width(); ++x) {
      float& u = forward.u.at(x, y);
      float& v = forward.v.at(x, y);
      const float tx = static_cast<float>(x) + u, ty = static_cast<float>(y) + v;
      const double du = u + bilinear(backward.u, tx, ty);
      const double dv = v + bilinear(backward.v, tx, ty);
      if (!(std::hypot(du, dv) < tolerance + relative * std::hypot(u, v))) u = v = kNoValue;
    }
  }
}

}  // namespace kys_slam
