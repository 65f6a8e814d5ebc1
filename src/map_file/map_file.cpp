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

std::vector<std::uint8_t> bytes_of(const std::filesystem::path& path) {
  std::vector<std::uint8_t> bytes = read_bytes(path, kMaxFileSize);
  constexpr std::size_t kGrowth = 4;  // objects and indices beside the plain numbers
  check_memory(path.string(), kGrowth * bytes.size());
  return bytes;
}

}  // namespace

void save_map(const Map& map, const std::filesystem::path& path, std::string_view label_space) {
  write_file_atomic(path, encode_map(map, label_space));
}

Map load_map(const std::filesystem::path& path, std::string_view label_space) {
  return parse_map(bytes_of(path), path.string(), label_space);
}

Map load_map_of_any_labels(const std::filesystem::path& path) {
  return parse_map(bytes_of(path), path.string(), std::nullopt);
}

StoredMap load_stored_map(const std::filesystem::path& path) {
  return parse_stored_map(bytes_of(path), path.string(), std::nullopt);
}

}  // namespace kys_slam
