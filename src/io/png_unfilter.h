// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

namespace kys_slam {

/// Undoes a PNG row filter (PNG specification, section 9): out = reconstructed row.
/// \param filter  0 none, 1 sub, 2 up, 3 average, 4 Paeth
/// \param in      `size` filtered bytes
/// \param above   reconstructed row above, or nullptr for the first row
/// \param bpp     bytes per pixel, 1..8
/// \param out     `size` bytes, not overlapping `in`
/// \return false when `filter` is none of these
bool png_unfilter_row(int filter, const std::uint8_t* in, const std::uint8_t* above,
                      std::size_t size, std::size_t bpp, std::uint8_t* out);

}  // namespace kys_slam
