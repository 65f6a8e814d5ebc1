// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_file.h>

#include <cstdint>
#include <span>
#include <string>

namespace kys_slam {

/// JPEG in memory, decoded by libjpeg-turbo. Any warning of the decoder (truncation, damaged
/// entropy data) is an InputError naming `name`, because the decoder would invent pixels.
bool is_jpeg(std::span<const std::uint8_t> file);
ImageInfo jpeg_info(std::span<const std::uint8_t> file, const std::string& name);
GrayImage decode_jpeg_gray(std::span<const std::uint8_t> file, const std::string& name);
RgbImage decode_jpeg_rgb(std::span<const std::uint8_t> file, const std::string& name);

}  // namespace kys_slam
