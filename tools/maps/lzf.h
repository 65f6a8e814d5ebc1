// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace kys_slam {

/// Bytes that a byte of LZF becomes at most: three bytes copy 264.
inline constexpr std::size_t kMostLzfGrowth = 88;

/// Unpacks LZF (Lehmann, LibLZF), as PCD files have it. \param size of the result, bytes
/// \throws std::invalid_argument when the data are damaged or of another size
std::string unpack_lzf(std::string_view packed, std::size_t size);

}  // namespace kys_slam
