#pragma once

#include <kys_slam/image.h>

#include <cstdint>
#include <limits>

namespace kys_slam {

/// Disparity images are in px, NaN where there is none. Inverse depth images are in 1/m, NaN where
/// there is none. Flow images are in px, both components NaN where there is none.
inline constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

struct FlowField {
  ImageOf<float> u;
  ImageOf<float> v;
};

/// 1/Z = disparity / (f B), at least 1 / max_depth. Disparities that are not positive numbers have
/// no depth.
/// \param bf focal length times baseline, px m.  \param max_depth m.
ImageOf<float> inverse_depth(const ImageOf<float>& disparity, double bf, double max_depth);

/// The right view's disparity from the left one: each pixel moves to u - disparity (rounded), the
/// nearest surface wins; pixels nothing arrives at are NaN, and so are those where a farther
/// surface shows through a gap of at most 2 px in a nearer one, or lies behind the one at the left
/// view's right border, of which the right view sees more. \param left_labels,right_labels
/// class of each pixel. Given both, a pixel arrives only at one of its own class: what is hidden in
/// the right view by something the left view gives no disparity of (too near, or unmatched) would
/// otherwise land on that.
ImageOf<float> warp_disparity_to_right(const ImageOf<float>& left,
                                       const ImageOf<std::uint16_t>* left_labels = nullptr,
                                       const ImageOf<std::uint16_t>* right_labels = nullptr);

/// Sets to NaN what the other view's disparity contradicts by more than `tolerance` px or cannot
/// confirm. `sign` -1 for the left view (its pixel u is at u - d in the right), +1 for the right.
void check_left_right(ImageOf<float>& disparity, const ImageOf<float>& other, int sign,
                      double tolerance);

/// Sets to NaN the flow where |F + B(p + F)| >= tolerance + relative |F|, B looked up bilinearly.
void check_forward_backward(FlowField& forward, const FlowField& backward, double tolerance,
                            double relative);

}  // namespace kys_slam
