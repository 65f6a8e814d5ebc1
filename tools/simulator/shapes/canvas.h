// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/common/rng.h"
#include "simulator/shapes/texture.h"

namespace kys_slam::simulator {

/// A square drawing of albedos that tiles; coordinates are fractions of the tile, origin at the
/// lower left, so that v grows upwards on a wall.
class Canvas {
 public:
  Canvas(int side, float fill);

  /// Adds fractal noise: octaves from `cells` lattice cells per tile upwards, each as strong as
  /// `amplitude` times gain^octave. Gain 1 gives detail at every distance alike.
  void noise(std::uint64_t seed, int cells, int octaves, float amplitude, float gain = 1.0F,
             float stretch = 1.0F);
  /// Adds round spots of the given radius (tiles) and contrast (random sign).
  void spots(Rng& rng, int count, float radius_low, float radius_high, float contrast);
  void rect(float u0, float v0, float u1, float v1, float value);
  void add_rect(float u0, float v0, float u1, float v1, float delta);
  void disc(float u, float v, float radius, float value);
  void line(float u0, float v0, float u1, float v1, float width, float value);
  /// A row of pseudo letters inside the rectangle.
  void text(Rng& rng, float u0, float v0, float u1, float v1, int letters, float value);
  void scale(float gain, float offset);

  [[nodiscard]] int side() const { return side_; }
  [[nodiscard]] float& at(int x, int y) { return a_[static_cast<std::size_t>(y) * side_ + x]; }
  [[nodiscard]] Texture texture() const { return {side_, a_}; }

 private:
  int side_;
  std::vector<float> a_;
};

}  // namespace kys_slam::simulator
