// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/prior_format.h>
#include <libdeflate.h>

#include <cmath>

namespace kys_slam::prior_format {

const std::array<float, 256>& motion_of_code() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (int q = 0; q < 256; ++q) {
      values[static_cast<std::size_t>(q)] =
          static_cast<float>(std::expm1(q * std::log(101.0) / 255.0));
    }
    values[255] = 100.0F;
    return values;
  }();
  return table;
}

std::uint32_t crc32(const std::uint8_t* bytes, std::size_t size) {
  return libdeflate_crc32(0, bytes, size);
}

}  // namespace kys_slam::prior_format
