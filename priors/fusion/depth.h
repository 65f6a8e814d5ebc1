// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <limits>
#include <vector>

#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Disparity images are in px, NaN where there is none. Flow images are in px, both components NaN
/// where there is none.
inline constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

struct FlowField {
  ImageOf<float> u;
  ImageOf<float> v;
};

/// 1/Z (1/m) from a disparity (px): disparity / (f B), at least 1 / max_depth. Disparities that are
/// not positive numbers have no depth.
struct InverseDepth {
  float scale, least;

  /// \param bf focal length times baseline, px m.  \param max_depth m.
  InverseDepth(double bf, double max_depth)
      : scale(static_cast<float>(1.0 / bf)), least(static_cast<float>(1.0 / max_depth)) {}

  [[gnu::always_inline]] float operator()(float disparity) const {
    const float value = disparity * scale;
    const float capped = value < least ? least : value;
    return disparity > 0 ? capped : kNoValue;
  }
};

/// The class of every pixel: that of the segment it lies in.
struct ClassImage {
  const ImageOf<std::uint16_t>* segment_map = nullptr;
  std::vector<std::uint16_t> class_of;  ///< by segment number
};
/// The map must outlive the result. Void is class 65535.
ClassImage class_image(const PanopticMap& map);

/// Warps the left disparity to the right view: each pixel moves to u - disparity (rounded), and the
/// nearest surface wins. Pixels without a source are NaN. So are pixels where a farther surface
/// shows through a gap of at most 2 px in a nearer one, and pixels behind the surface at the right
/// border of the left view.
/// \param left_classes,right_classes if both are given, a pixel keeps its class: an object without
///   left disparity (too near, or unmatched) would otherwise get the disparity of the background it
///   occludes
ImageOf<float> warp_disparity_to_right(const ImageOf<float>& left,
                                       const ClassImage* left_classes = nullptr,
                                       const ClassImage* right_classes = nullptr);

/// Left-right check: sets to NaN the pixels whose disparity differs by more than `tolerance` px
/// from that of the other view, or has no counterpart there. `sign`: -1 for the left view (its
/// pixel u is at u - d in the right view), +1 for the right.
void check_left_right(ImageOf<float>& disparity, const ImageOf<float>& other, int sign,
                      double tolerance);

/// Sets to NaN the flow where |F + B(p + F)| >= tolerance + relative |F|, B looked up bilinearly.
void check_forward_backward(FlowField& forward, const FlowField& backward, double tolerance,
                            double relative);

}  // namespace kys_slam
