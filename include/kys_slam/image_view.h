// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <cstddef>
#include <cstdint>
#include <string>

namespace kys_slam {

/// How the pixels of a view are stored.
enum class PixelFormat : std::uint8_t {
  kGray8,   ///< 8 bits
  kGray16,  ///< 16 bits, host byte order; ImageView::bits of them are in use
  kRgb8,    ///< three channels of 8 bits
  kBgr8,    ///< three channels of 8 bits, blue first (OpenCV)
};

/// Pixels in memory of the caller: a camera driver's buffer, a cv::Mat, a NumPy array. Steps may
/// have any size and sign, so that crops, flips and views of every second pixel need no copy.
struct ImageView {
  const void* data = nullptr;  ///< pixel (0, 0), first channel
  int width = 0;               ///< px
  int height = 0;              ///< px
  PixelFormat format = PixelFormat::kGray8;
  std::ptrdiff_t row_step = 0;      ///< bytes from one row to the next; 0: rows without gaps
  std::ptrdiff_t pixel_step = 0;    ///< bytes from one pixel to the next; 0: pixels without gaps
  std::ptrdiff_t channel_step = 1;  ///< bytes from one channel to the next
  /// kGray16: bits in use, 8 to 16, of which the upper 8 count. 0: 16, or as many as System::feed
  /// finds in its first pair.
  int bits = 0;
};

/// Bits that a view of 16-bit pixels uses, by its largest pixel: 8, 10, 12, 14 or 16. 0: other
/// formats, or black.
int used_bits(const ImageView& view);

/// A warning for the user about images that use this many of 16 bits; "" for 16 and 0.
std::string note_of_bits(int bits);

/// Converts a view to 8-bit grey: the upper byte of the bits in use, ITU-R BT.601 weights for
/// colour. The same conversion as read_gray(). \throws InputError for a view without pixels or with
/// a side above 16384 px.
GrayImage to_gray(const ImageView& view);

}  // namespace kys_slam
