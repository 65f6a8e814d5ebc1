#pragma once

#include <kys/descriptor.h>
#include <kys_slam/image.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// Distance from the image border at which orientation and descriptor still have all their pixels.
inline constexpr int kOrbMargin = 19;

/// Orientation of a corner: the direction from its centre to the intensity centroid of the disc of
/// radius 15 around it (ORB). Its cosine and sine follow from integer moments without passing
/// through the angle.
struct Orientation {
  float cosine = 1;
  float sine = 0;

  /// rad in [0, 2 pi).
  [[nodiscard]] float angle() const;
};

/// The corner lies at least kOrbMargin from the border. A patch without direction gets angle 0.
Orientation orientation(const GrayImage& image, int x, int y);

/// 256-bit BRIEF descriptor with the test pattern turned by exactly the orientation, its points
/// rounded to pixels.
/// \param blurred the corner's level after DescriptorBlur
kys::Descriptor orb_descriptor(const GrayImage& blurred, int x, int y, const Orientation& turn);

/// 7x7 Gaussian of sigma 2, edges repeated; fixed point, within one grey level of the exact value.
class DescriptorBlur {
 public:
  /// `blurred` takes the size of the image.
  void apply(const GrayImage& image, GrayImage& blurred);

 private:
  std::vector<std::uint16_t> column_;
};

}  // namespace kys_slam
