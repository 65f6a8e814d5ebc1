#pragma once

#include <kys/descriptor.h>
#include <kys_slam/image.h>

namespace kys_slam {

/// Distance from the image border at which orientation and descriptor still have all their pixels.
inline constexpr int kOrbMargin = 19;

/// Orientation of a corner by the intensity centroid of the disc of radius 15 around it (ORB),
/// rad in [0, 2 pi). The corner lies at least kOrbMargin from the border.
float corner_angle(const GrayImage& image, int x, int y);

/// 256-bit BRIEF descriptor with the test pattern turned by `angle` (in steps of 2 pi / 256).
/// \param blurred the corner's level after a 7x7 Gaussian, sigma 2
kys::Descriptor orb_descriptor(const GrayImage& blurred, int x, int y, float angle);

/// 7x7 Gaussian of sigma 2; borders mirrored. `blurred` takes the size of the image.
void blur_for_descriptors(const GrayImage& image, GrayImage& blurred);

}  // namespace kys_slam
