// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace kys_slam {

/// ITU-R BT.601 luma in 14-bit fixed point.
inline std::uint8_t luma(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  return static_cast<std::uint8_t>((r * 4899 + g * 9617 + b * 1868 + 8192) >> 14);
}

/// The upper 8 of the lower `bits` bits (8 to 16) of a sample; 255 for a sample that has more.
inline std::uint8_t upper_byte(std::uint16_t sample, int bits) {
  return static_cast<std::uint8_t>(std::min(sample >> (bits - 8), 255));
}

/// Bits of a camera whose largest 16-bit sample is this one: 8, 10, 12, 14 or 16; 0 for a sample of
/// 0.
inline int bits_of_largest(std::uint16_t sample) {
  if (sample == 0) return 0;
  return std::max(8, (static_cast<int>(std::bit_width(sample)) + 1) / 2 * 2);
}

}  // namespace kys_slam
