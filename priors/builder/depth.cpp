#include "priors/builder/depth.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace kys_slam {
namespace {

constexpr int kReach = 2;      // px
constexpr float kStep = 1.0F;  // px of disparity; less is the surface's own slope

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

/// A surface that is wider in the right view arrives with gaps of a pixel or two. What is seen
/// through them does not belong there. Where the classes (`labels`, may be null) say that the
/// surface goes on, the gap is filled from its sides.
void close_gaps(const std::vector<float>& row, const std::uint16_t* labels, float* out) {
  const int width = static_cast<int>(row.size());
  const auto at = [&](int x) { return row[static_cast<std::size_t>(x)]; };
  // How far away a nearer surface is (any, when there is none here); 0: not within reach.
  const auto nearer = [&](int x, int step) {
    for (int i = 1; i <= kReach && x + i * step >= 0 && x + i * step < width; ++i) {
      const float side = at(x + i * step);
      if (side > at(x) + kStep || (std::isnan(at(x)) && !std::isnan(side))) return i;
    }
    return 0;
  };
  for (int x = 0; x < width; ++x) {
    out[x] = at(x);
    const int left = nearer(x, -1), right = left == 0 ? 0 : nearer(x, 1);
    if (right == 0) continue;
    const float a = at(x - left), b = at(x + right);
    const bool same_surface = labels != nullptr && labels[x] == labels[x - left] &&
                              labels[x] == labels[x + right] &&
                              std::abs(a - b) <= kStep * static_cast<float>(left + right);
    const float share = static_cast<float>(left) / static_cast<float>(left + right);
    out[x] = same_surface ? a + share * (b - a) : kNoValue;
  }
}

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
void clear_behind_border(const Border& border, const std::uint16_t* left_labels,
                         const std::uint16_t* right_labels, std::vector<float>& row) {
  if (border.x < 0) return;
  const int width = static_cast<int>(row.size());
  const float end = static_cast<float>(border.x) - border.disparity + 0.5F;
  for (int x = end < 0 ? 0 : static_cast<int>(end) + 1; x < width; ++x) {
    const bool same_class = right_labels == nullptr || right_labels[x] == left_labels[border.x];
    float& d = row[static_cast<std::size_t>(x)];
    if (same_class && d < border.disparity - kStep) d = kNoValue;
  }
}

}  // namespace

ImageOf<float> inverse_depth(const ImageOf<float>& disparity, double bf, double max_depth) {
  ImageOf<float> result(disparity.width(), disparity.height());
  const auto scale = static_cast<float>(1.0 / bf);
  const auto least = static_cast<float>(1.0 / max_depth);
  const float* d = disparity.data();
  float* out = result.data();
  for (std::size_t i = 0; i < disparity.size(); ++i) {
    const float value = d[i] * scale;
    const float capped = value < least ? least : value;
    out[i] = d[i] > 0 ? capped : kNoValue;
  }
  return result;
}

ImageOf<float> warp_disparity_to_right(const ImageOf<float>& left,
                                       const ImageOf<std::uint16_t>* left_labels,
                                       const ImageOf<std::uint16_t>* right_labels) {
  const int width = left.width();
  const bool labels = left_labels != nullptr && right_labels != nullptr;
  ImageOf<float> right(width, left.height(), kNoValue);
  std::vector<float> row(static_cast<std::size_t>(width));
  for (int y = 0; y < left.height(); ++y) {
    const float* in = left.row(y);
    std::fill(row.begin(), row.end(), kNoValue);
    for (int x = 0; x < width; ++x) {
      const float d = in[x];
      if (!(d > 0 && d < static_cast<float>(width))) continue;
      const int target = static_cast<int>(static_cast<float>(x) - d + 0.5F);
      if (static_cast<float>(x) - d + 0.5F < 0) continue;
      if (labels && left_labels->at(x, y) != right_labels->at(target, y)) continue;
      float& out = row[static_cast<std::size_t>(target)];
      if (!(out > d)) out = d;  // true for NaN as well
    }
    clear_behind_border(border_of(in, width), labels ? left_labels->row(y) : nullptr,
                        labels ? right_labels->row(y) : nullptr, row);
    close_gaps(row, labels ? right_labels->row(y) : nullptr, right.row(y));
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
