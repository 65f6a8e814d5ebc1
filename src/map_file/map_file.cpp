// SPDX-License-Identifier: BSD-3-Clause
#include "map_file/map_file.h"

#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/read_bytes.h>

#include <cstdint>
#include <utility>
#include <vector>

namespace kys_slam {

namespace {
constexpr std::size_t kMaxFileSize = std::size_t{1} << 32;  // bytes
}

void save_map(const Map& map, const std::filesystem::path& path, std::string_view label_space) {
  write_file_atomic(path, encode_map(map, label_space));
}

Map load_map(const std::filesystem::path& path, std::string_view label_space) {
  std::vector<std::uint8_t> bytes = read_bytes(path, kMaxFileSize);
  constexpr std::size_t kGrowth = 4;  // objects and indices beside the plain numbers
  check_memory(path.string(), kGrowth * bytes.size());
  return parse_map(std::move(bytes), path.string(), label_space);
}

}  // namespace kys_slam
