// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/image_file.h>

#include <cstdint>
#include <span>
#include <string>

namespace kys_slam {

/// Binary PGM and PPM files (P5, P6; 8 or 16 bits): some robots' recorders write them.
bool is_pnm(std::span<const std::uint8_t> file);

/// \throws InputError naming the file: not such a file, truncated, or unreasonably large.
ImageInfo pnm_info(std::span<const std::uint8_t> file, const std::string& name);

/// As 8-bit grey. Samples of 8 bits are scaled by the file's largest value. \param bits of 16-bit
/// samples, of which the upper 8 count
GrayImage decode_pnm_gray(std::span<const std::uint8_t> file, const std::string& name, int bits);
RgbImage decode_pnm_rgb(std::span<const std::uint8_t> file, const std::string& name);

/// The largest sample of a file of 16 bits.
std::uint16_t largest_pnm_sample(std::span<const std::uint8_t> file, const std::string& name);

}  // namespace kys_slam
