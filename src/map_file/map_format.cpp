// SPDX-License-Identifier: BSD-3-Clause
#include "map_file/map_format.h"

#include <libdeflate.h>

namespace kys_slam::map_format {

std::uint32_t checksum(std::span<const std::uint8_t> bytes) {
  return libdeflate_crc32(0, bytes.data(), bytes.size());
}

void append_chunk(ByteWriter& file, std::span<const std::uint8_t> content) {
  file.u32(static_cast<std::uint32_t>(content.size()));
  file.raw(content);
}

std::span<const std::uint8_t> take_chunk(ByteReader& file) {
  const std::size_t size = file.count(1);
  return file.raw(size);
}

}  // namespace kys_slam::map_format
