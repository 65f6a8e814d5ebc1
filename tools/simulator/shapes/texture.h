// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace kys_slam::simulator {

/// A square grey texture that tiles, with its mip pyramid (box filtered, down to 1x1).
class Texture {
 public:
  Texture() = default;
  /// `albedo` holds side*side values in [0, 1], row-major; `side` is a power of two.
  Texture(int side, const std::vector<float>& albedo);

  /// Mean albedo over a footprint: centre (u, v) in tiles, and the footprint's two half-open axes
  /// as tile-space vectors (du1, dv1), (du2, dv2). Samples along the longer axis, at most
  /// `max_probes`, each with trilinear interpolation.
  [[nodiscard]] float sample(float u, float v, float du1, float dv1, float du2, float dv2,
                             int max_probes) const;

  [[nodiscard]] int side() const { return side_; }

 private:
  [[nodiscard]] float trilinear(float u, float v, float lod) const;
  [[nodiscard]] float bilinear(float u, float v, int level) const;

  int side_ = 0;
  int levels_ = 0;
  std::vector<std::uint8_t> texels_;    ///< all levels, finest first
  std::vector<std::uint32_t> offsets_;  ///< of each level in texels_
};

}  // namespace kys_slam::simulator
