#pragma once

#include <kys_slam/image_file.h>

#include <cstdint>
#include <span>
#include <string>

namespace kys_slam {

/// JPEG held in memory, through libjpeg-turbo. Any warning of the decoder (truncation, damaged
/// entropy data) is an InputError naming `name`: it would leave made-up pixels.
bool is_jpeg(std::span<const std::uint8_t> file);
ImageInfo jpeg_info(std::span<const std::uint8_t> file, const std::string& name);
GrayImage decode_jpeg_gray(std::span<const std::uint8_t> file, const std::string& name);
RgbImage decode_jpeg_rgb(std::span<const std::uint8_t> file, const std::string& name);

}  // namespace kys_slam
