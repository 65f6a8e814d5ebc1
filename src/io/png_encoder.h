// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// The bytes of a PNG file. `pixels` is row-major, samples of 16 bits in host byte order.
/// \param channels  1 (grey) or 3 (R, G, B)
/// \param bits      8 or 16
std::vector<std::uint8_t> encode_png(const void* pixels, int width, int height, int channels,
                                     int bits);

}  // namespace kys_slam
