// SPDX-License-Identifier: BSD-3-Clause
#include "features/pyramid.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace kys_slam {

namespace {

constexpr int kSpan = 16;  // input pixels within reach of one group

/// Left tap and the right tap's weight in 1/steps of output pixel i; taps lie inside the input.
struct Tap {
  int at;
  int weight;
};

Tap tap_of(int i, int from, int to, int steps) {
  const double position = (i + 0.5) * from / to - 0.5;
  const double inside = std::clamp(position, 0.0, from - 1.0);
  const int at = std::min(static_cast<int>(inside), std::max(0, from - 2));
  return {at, static_cast<int>(std::lround((inside - at) * steps))};
}

Eigen::Vector2f between(const GrayImage& from, const GrayImage& to, float x, float y) {
  const float sx = static_cast<float>(to.width()) / static_cast<float>(from.width());
  const float sy = static_cast<float>(to.height()) / static_cast<float>(from.height());
  return {(x + 0.5f) * sx - 0.5f, (y + 0.5f) * sy - 0.5f};
}

/// Any ratio and size: four taps a pixel. Only for levels too small or too coarse for the groups.
void reduce_plainly(const GrayImage& from, GrayImage& to) {
  for (int y = 0; y < to.height(); ++y) {
    const Tap v = tap_of(y, from.height(), to.height(), 256);
    const std::uint8_t* upper = from.row(v.at);
    const std::uint8_t* lower = from.row(std::min(v.at + 1, from.height() - 1));
    for (int x = 0; x < to.width(); ++x) {
      const Tap u = tap_of(x, from.width(), to.width(), 256);
      const int right = std::min(u.at + 1, from.width() - 1);
      const int above = upper[u.at] * (256 - u.weight) + upper[right] * u.weight;
      const int below = lower[u.at] * (256 - u.weight) + lower[right] * u.weight;
      to.at(x, y) =
          static_cast<std::uint8_t>((above * (256 - v.weight) + below * v.weight + 32768) >> 16);
    }
  }
}

}  // namespace

Eigen::Vector2f ImagePyramid::to_level(std::size_t octave, float x, float y) const {
  return between(levels[0], levels[octave], x, y);
}

Eigen::Vector2f ImagePyramid::to_full(std::size_t octave, float x, float y) const {
  return between(levels[octave], levels[0], x, y);
}

void Reducer::plan(int from_width, int to_width) {
  if (from_width == from_width_ && to_width == to_width_) return;
  from_width_ = from_width;
  to_width_ = to_width;
  const int count = (to_width + kernels::kResizeGroup - 1) / kernels::kResizeGroup;
  first_.assign(static_cast<std::size_t>(count), 0);
  groups_.assign(static_cast<std::size_t>(count), {});
  for (int g = 0; g < count; ++g) {
    const auto index = static_cast<std::size_t>(g);
    const int start = g * kernels::kResizeGroup;
    first_[index] = std::min(tap_of(start, from_width, to_width, 256).at, from_width - kSpan);
    for (int i = 0; i < kernels::kResizeGroup; ++i) {
      const Tap tap = tap_of(std::min(start + i, to_width - 1), from_width, to_width, 256);
      const int weight = std::clamp(tap.weight, 1, 255);  // a byte holds no 256
      const int offset = tap.at - first_[index];
      const auto k = static_cast<std::size_t>(2 * i);
      groups_[index].tap[k] = static_cast<std::uint8_t>(offset);
      groups_[index].tap[k + 1] = static_cast<std::uint8_t>(offset + 1);
      groups_[index].weight[k] = static_cast<std::uint8_t>(256 - weight);
      groups_[index].weight[k + 1] = static_cast<std::uint8_t>(weight);
    }
  }
  for (auto& row : rows_) row.resize(static_cast<std::size_t>(count * kernels::kResizeGroup));
}

void Reducer::reduce(const GrayImage& from, GrayImage& to) {
  // A group of eight pixels must find all its taps among sixteen.
  const bool fits = from.width() >= kSpan && from.height() >= 2 &&
                    (kernels::kResizeGroup - 1) * from.width() <= (kSpan - 3) * to.width();
  if (!fits) {
    reduce_plainly(from, to);
    return;
  }
  plan(from.width(), to.width());
  const kernels::Kernels& k = kernels::kernels();
  int held[2] = {-1, -1};  // input rows whose horizontal half is in rows_
  const auto row_of = [&](int y) {
    auto& row = rows_[y & 1];
    if (held[y & 1] != y) {
      k.resize_row(from.row(y), first_.data(), groups_.data(), static_cast<int>(groups_.size()),
                   row.data());
      held[y & 1] = y;
    }
    return row.data();
  };
  for (int y = 0; y < to.height(); ++y) {
    const Tap tap = tap_of(y, from.height(), to.height(), 32768);
    const std::int16_t* upper = row_of(tap.at);
    const std::int16_t* lower = row_of(tap.at + 1);
    k.blend_rows(upper, lower, std::min(tap.weight, 32767), to.width(), to.row(y));
  }
}

void PyramidBuilder::build(const GrayImage& image, double scale_factor, int levels,
                           ImagePyramid& pyramid) {
  pyramid.levels.resize(static_cast<std::size_t>(levels));
  reducers_.resize(static_cast<std::size_t>(levels));
  pyramid.levels[0] = image;
  double scale = 1;
  for (std::size_t level = 1; level < pyramid.levels.size(); ++level) {
    scale *= scale_factor;
    const int width = static_cast<int>(std::lround(image.width() / scale));
    const int height = static_cast<int>(std::lround(image.height() / scale));
    GrayImage& to = pyramid.levels[level];
    const GrayImage& from = pyramid.levels[level - 1];
    if (width < 1 || height < 1 || from.empty()) {
      to = GrayImage();
      continue;
    }
    if (to.width() != width || to.height() != height) to = GrayImage(width, height);
    reducers_[level].reduce(from, to);
  }
}

}  // namespace kys_slam
