// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_view.h>

#include <algorithm>
#include <cstring>
#include <string>

#include "io/luma.h"

namespace kys_slam {

namespace {

std::ptrdiff_t pixel_size(PixelFormat format) {
  switch (format) {
    case PixelFormat::kGray8:
      return 1;
    case PixelFormat::kGray16:
      return 2;
    case PixelFormat::kRgb8:
    case PixelFormat::kBgr8:
      break;
  }
  return 3;
}

/// Calls gray(pixel) for every pixel of the view.
template <typename ToGray>
void convert(const ImageView& view, GrayImage& image, ToGray&& gray) {
  const auto* first = static_cast<const std::uint8_t*>(view.data);
  for (int y = 0; y < view.height; ++y) {
    const std::uint8_t* row = first + y * view.row_step;
    std::uint8_t* out = image.row(y);
    for (int x = 0; x < view.width; ++x) out[x] = gray(row + x * view.pixel_step);
  }
}

/// Steps that are not given are those of pixels without gaps.
/// \throws InputError for a view without pixels or with a side that is too large
ImageView complete(ImageView view) {
  if (view.data == nullptr || view.width < 1 || view.height < 1) {
    throw InputError("an image without pixels");
  }
  if (view.width > kMaxImageSide || view.height > kMaxImageSide) {
    throw InputError("an image of " + std::to_string(view.width) + "x" +
                     std::to_string(view.height) + " px is too large");
  }
  if (view.pixel_step == 0) view.pixel_step = pixel_size(view.format);
  if (view.row_step == 0) view.row_step = view.pixel_step * view.width;
  return view;
}

std::uint16_t sample_at(const std::uint8_t* p) {
  std::uint16_t value = 0;
  std::memcpy(&value, p, sizeof value);
  return value;
}

}  // namespace

int used_bits(const ImageView& given) {
  if (given.format != PixelFormat::kGray16) return 0;
  const ImageView view = complete(given);
  const auto* first = static_cast<const std::uint8_t*>(view.data);
  std::uint16_t largest = 0;
  for (int y = 0; y < view.height; ++y) {
    const std::uint8_t* row = first + y * view.row_step;
    for (int x = 0; x < view.width; ++x) {
      largest = std::max(largest, sample_at(row + x * view.pixel_step));
    }
  }
  return bits_of_largest(largest);
}

std::string note_of_bits(int bits) {
  if (bits == 0 || bits == 16) return "";
  return "16-bit images of which " + std::to_string(bits) +
         " bits are used: the upper 8 of these are taken";
}

GrayImage to_gray(const ImageView& given) {
  const ImageView view = complete(given);
  const int bits = view.bits == 0 ? 16 : view.bits;
  if (bits < 8 || bits > 16) throw InputError("an image of " + std::to_string(bits) + " bits");
  auto image = GrayImage::for_overwrite(view.width, view.height);
  const std::ptrdiff_t c = view.channel_step;
  switch (view.format) {
    case PixelFormat::kGray8:
      if (view.pixel_step == 1) {
        const auto* first = static_cast<const std::uint8_t*>(view.data);
        for (int y = 0; y < view.height; ++y) {
          std::memcpy(image.row(y), first + y * view.row_step,
                      static_cast<std::size_t>(view.width));
        }
      } else {
        convert(view, image, [](const std::uint8_t* p) { return *p; });
      }
      break;
    case PixelFormat::kGray16:
      convert(view, image,
              [bits](const std::uint8_t* p) { return upper_byte(sample_at(p), bits); });
      break;
    case PixelFormat::kRgb8:
      convert(view, image, [c](const std::uint8_t* p) { return luma(p[0], p[c], p[2 * c]); });
      break;
    case PixelFormat::kBgr8:
      convert(view, image, [c](const std::uint8_t* p) { return luma(p[2 * c], p[c], p[0]); });
      break;
  }
  return image;
}

}  // namespace kys_slam
