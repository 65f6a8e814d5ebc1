#include "map_file/map_file.h"

#include "io/read_bytes.h"
#include "util/atomic_file.h"

namespace kys_slam {

namespace {
constexpr std::size_t kMaxFileSize = std::size_t{1} << 32;  // bytes
}

void save_map(const Map& map, const std::filesystem::path& path, std::string_view label_space) {
  write_file_atomic(path, encode_map(map, label_space));
}

Map load_map(const std::filesystem::path& path, std::string_view label_space) {
  return parse_map(read_bytes(path, kMaxFileSize), path.string(), label_space);
}

}  // namespace kys_slam
