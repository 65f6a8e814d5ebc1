// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace kys_slam {

/// ITU-R BT.601 luma in 14-bit fixed point.
inline std::uint8_t luma(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  return static_cast<std::uint8_t>((r * 4899 + g * 9617 + b * 1868 + 8192) >> 14);
}

}  // namespace kys_slam
