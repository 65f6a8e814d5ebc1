// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>
#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// Least distance from the image border, px, at which orientation and descriptor have all pixels.
inline constexpr int kOrbMargin = 19;

/// Orientation of a corner: the direction from its centre to the intensity centroid of the disc of
/// radius 15 px around it (ORB). Cosine and sine are computed from integer moments, without the
/// angle.
struct Orientation {
  float cosine = 1;
  float sine = 0;

  /// rad in [0, 2 pi).
  [[nodiscard]] float angle() const;
};

/// The corner lies at least kOrbMargin from the border. A patch without a direction gets angle 0.
Orientation orientation(const GrayImage& image, int x, int y);

/// 256-bit BRIEF descriptor with the test pattern rotated by the exact orientation, its points
/// rounded to pixels.
/// \param blurred the corner's level after DescriptorBlur
kys::Descriptor orb_descriptor(const GrayImage& blurred, int x, int y, const Orientation& turn);

/// 7x7 Gaussian, sigma 2 px, edge pixels repeated. Fixed point, within one grey level of the exact
/// value.
class DescriptorBlur {
 public:
  /// `blurred` gets the size of the image.
  void apply(const GrayImage& image, GrayImage& blurred);

 private:
  std::vector<std::uint16_t> column_;
};

}  // namespace kys_slam
