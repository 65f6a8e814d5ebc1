// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/shapes/canvas.h"

#include <algorithm>
#include <cmath>

namespace kys_slam::simulator {

Canvas::Canvas(int side, float fill)
    : side_(side), a_(static_cast<std::size_t>(side) * side, fill) {}

namespace {

float lattice(std::uint64_t seed, int x, int y) {
  return static_cast<float>(
             hash_of(seed, static_cast<std::uint64_t>(x), static_cast<std::uint64_t>(y)) >> 40) *
             (2.0F / 16777216.0F) -
         1.0F;
}

float smooth(float t) {
  return t * t * (3 - 2 * t);
}

}  // namespace

void Canvas::noise(std::uint64_t seed, int cells, int octaves, float amplitude, float gain,
                   float stretch) {
  float amp = amplitude;
  int cx = cells;
  for (int o = 0; o < octaves && cx <= side_; ++o, cx *= 2, amp *= gain) {
    const int cy = std::max(1, static_cast<int>(static_cast<float>(cx) / stretch));
    std::vector<float> grid(static_cast<std::size_t>(cx) * cy);
    for (int y = 0; y < cy; ++y) {
      for (int x = 0; x < cx; ++x) {
        grid[static_cast<std::size_t>(y) * cx + x] =
            lattice(seed + static_cast<std::uint64_t>(o) * 7919, x, y);
      }
    }
    // The same for every row: which lattice columns, and the weight of the second.
    struct Between {
      int first, second;
      float weight;
    };
    const auto between = [this](int at, int count) {
      const float g =
          static_cast<float>(at) * static_cast<float>(count) / static_cast<float>(side_);
      const int k = static_cast<int>(g) % count;
      return Between{k, (k + 1) % count, smooth(g - std::floor(g))};
    };
    std::vector<Between> columns;
    columns.reserve(static_cast<std::size_t>(side_));
    for (int x = 0; x < side_; ++x) columns.push_back(between(x, cx));
    std::vector<float> row(static_cast<std::size_t>(cx));
    for (int y = 0; y < side_; ++y) {
      const Between b = between(y, cy);
      const float* r0 = grid.data() + static_cast<std::size_t>(b.first) * cx;
      const float* r1 = grid.data() + static_cast<std::size_t>(b.second) * cx;
      for (std::size_t x = 0; x < row.size(); ++x) {
        row[x] = amp * (r0[x] * (1 - b.weight) + r1[x] * b.weight);
      }
      for (int x = 0; x < side_; ++x) {
        const Between& c = columns[static_cast<std::size_t>(x)];
        at(x, y) += row[static_cast<std::size_t>(c.first)] * (1 - c.weight) +
                    row[static_cast<std::size_t>(c.second)] * c.weight;
      }
    }
  }
}

void Canvas::spots(Rng& rng, int count, float radius_low, float radius_high, float contrast) {
  for (int i = 0; i < count; ++i) {
    const float u = static_cast<float>(rng.uniform()) * static_cast<float>(side_);
    const float v = static_cast<float>(rng.uniform()) * static_cast<float>(side_);
    const float r = std::max(
        0.6F, static_cast<float>(rng.uniform(radius_low, radius_high)) * static_cast<float>(side_));
    const float aspect = static_cast<float>(rng.uniform(0.6, 1.7));
    const float delta = contrast * static_cast<float>(rng.uniform(-1, 1));
    const int reach = static_cast<int>(r * 1.7F) + 1;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        const float x = static_cast<float>(dx) / aspect;
        const float y = static_cast<float>(dy) * aspect;
        if (x * x + y * y > r * r) continue;
        at((static_cast<int>(u) + dx + 8 * side_) % side_,
           (static_cast<int>(v) + dy + 8 * side_) % side_) += delta;
      }
    }
  }
}

void Canvas::rect(float u0, float v0, float u1, float v1, float value) {
  const float n = static_cast<float>(side_);
  for (int y = std::max(0, static_cast<int>(v0 * n)); y < std::min(n, v1 * n); ++y) {
    for (int x = std::max(0, static_cast<int>(u0 * n)); x < std::min(n, u1 * n); ++x) {
      at(x, y) = value;
    }
  }
}

void Canvas::add_rect(float u0, float v0, float u1, float v1, float delta) {
  const float n = static_cast<float>(side_);
  for (int y = std::max(0, static_cast<int>(v0 * n)); y < std::min(n, v1 * n); ++y) {
    for (int x = std::max(0, static_cast<int>(u0 * n)); x < std::min(n, u1 * n); ++x) {
      at(x, y) += delta;
    }
  }
}

void Canvas::disc(float u, float v, float radius, float value) {
  const float n = static_cast<float>(side_);
  for (int y = std::max(0.0F, (v - radius) * n); y < std::min(n, (v + radius) * n); ++y) {
    for (int x = std::max(0.0F, (u - radius) * n); x < std::min(n, (u + radius) * n); ++x) {
      const float dx = (static_cast<float>(x) + 0.5F) / n - u;
      const float dy = (static_cast<float>(y) + 0.5F) / n - v;
      if (dx * dx + dy * dy < radius * radius) at(x, y) = value;
    }
  }
}

void Canvas::line(float u0, float v0, float u1, float v1, float width, float value) {
  const float n = static_cast<float>(side_);
  const float length = std::hypot(u1 - u0, v1 - v0);
  const int steps = static_cast<int>(length * n * 2) + 1;
  for (int i = 0; i <= steps; ++i) {
    const float k = static_cast<float>(i) / static_cast<float>(steps);
    const float u = u0 + (u1 - u0) * k;
    const float v = v0 + (v1 - v0) * k;
    rect(u - width / 2, v - width / 2, u + width / 2, v + width / 2, value);
  }
}

void Canvas::text(Rng& rng, float u0, float v0, float u1, float v1, int letters, float value) {
  const float pitch = (u1 - u0) / static_cast<float>(letters);
  const float w = pitch * 0.68F;
  const float stroke = std::min(pitch * 0.17F, (v1 - v0) * 0.2F);
  const float h = v1 - v0;
  for (int i = 0; i < letters; ++i) {
    const float x = u0 + pitch * static_cast<float>(i);
    const auto shape = rng.bits();
    if ((shape & 1) != 0) rect(x, v0, x + stroke, v1, value);
    if ((shape & 2) != 0) rect(x + w - stroke, v0, x + w, v1, value);
    if ((shape & 4) != 0) rect(x, v0, x + w, v0 + stroke, value);
    if ((shape & 8) != 0) rect(x, v0 + h / 2 - stroke / 2, x + w, v0 + h / 2 + stroke / 2, value);
    if ((shape & 16) != 0) rect(x, v1 - stroke, x + w, v1, value);
    if ((shape & 32) != 0) line(x, v0, x + w, v1, stroke * 0.9F, value);
    if ((shape & 63) == 0) rect(x + w / 2 - stroke, v0, x + w / 2 + stroke, v1, value);
  }
}

void Canvas::scale(float gain, float offset) {
  for (float& a : a_) a = a * gain + offset;
}

}  // namespace kys_slam::simulator
