// SPDX-License-Identifier: BSD-3-Clause
#include "messages.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <string_view>

namespace kys_slam::ros {

namespace {

struct Encoding {
  std::string_view name;
  PixelFormat format;
  std::size_t bytes;  // per pixel
};

constexpr std::array kEncodings{
    Encoding{"mono8", PixelFormat::kGray8, 1},   Encoding{"8UC1", PixelFormat::kGray8, 1},
    Encoding{"mono16", PixelFormat::kGray16, 2}, Encoding{"16UC1", PixelFormat::kGray16, 2},
    Encoding{"rgb8", PixelFormat::kRgb8, 3},     Encoding{"bgr8", PixelFormat::kBgr8, 3},
    Encoding{"8UC3", PixelFormat::kBgr8, 3},     Encoding{"rgba8", PixelFormat::kRgb8, 4},
    Encoding{"bgra8", PixelFormat::kBgr8, 4},    Encoding{"8UC4", PixelFormat::kBgr8, 4},
};

}  // namespace

const char* to_string(Side side) {
  return side == Side::kLeft ? "left" : "right";
}

void check_bytes(const ImageMessage& message, std::size_t bytes_per_pixel) {
  const std::size_t row = bytes_per_pixel * message.width;
  if (message.width > 0 && message.height > 0 && message.step >= row &&
      message.data.size() >= std::size_t{message.step} * (message.height - 1) + row) {
    return;
  }
  throw InputError("an image message of " + std::to_string(message.width) + "x" +
                   std::to_string(message.height) + " px, '" + message.encoding + "', step " +
                   std::to_string(message.step) + ", with " + std::to_string(message.data.size()) +
                   " bytes: too few");
}

ImageView view_of(const ImageMessage& message) {
  const auto* encoding = std::ranges::find(kEncodings, message.encoding, &Encoding::name);
  if (encoding == kEncodings.end()) {
    const bool bayer = message.encoding.starts_with("bayer_");
    throw InputError("image encoding '" + message.encoding + "' is not supported" +
                     (bayer ? "; image_proc makes colour images of it" : ""));
  }
  check_bytes(message, encoding->bytes);
  constexpr std::uint32_t kMostOfSide = 16384;  // of a side; to_gray() refuses more
  ImageView view{message.data.data(), static_cast<int>(std::min(message.width, kMostOfSide + 1)),
                 static_cast<int>(std::min(message.height, kMostOfSide + 1)), encoding->format,
                 static_cast<std::ptrdiff_t>(message.step)};
  view.pixel_step = static_cast<std::ptrdiff_t>(encoding->bytes);
  if (encoding->format == PixelFormat::kGray16 && message.is_bigendian) {
    view.format = PixelFormat::kGray8;  // the high byte alone
  }
  return view;
}

}  // namespace kys_slam::ros
