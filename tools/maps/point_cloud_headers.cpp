// SPDX-License-Identifier: BSD-3-Clause
// Headers of PLY (Turk, "The PLY polygon file format", 1994) and PCD 0.7 (Point Cloud Library).
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/parse_number.h>

#include <array>
#include <optional>
#include <stdexcept>
#include <utility>

#include "lzf.h"
#include "point_cloud.h"

namespace kys_slam::cloud_format {

namespace {

constexpr std::size_t kMostColumns = 1000;
constexpr std::size_t kMostLines = 100000;  // of a header

[[noreturn]] void refuse_header(const std::string& what) {
  throw std::invalid_argument(what);
}

std::size_t count_of(std::string_view word) {
  const auto number = parse_int(word);
  if (!number || *number < 0) refuse_header("has a header with a count that is none");
  return static_cast<std::size_t>(*number);
}

Type ply_type(std::string_view name) {
  using enum Type;
  constexpr std::array<std::pair<std::string_view, Type>, 16> kNames = {{{"char", kInt8},
                                                                         {"int8", kInt8},
                                                                         {"uchar", kUint8},
                                                                         {"uint8", kUint8},
                                                                         {"short", kInt16},
                                                                         {"int16", kInt16},
                                                                         {"ushort", kUint16},
                                                                         {"uint16", kUint16},
                                                                         {"int", kInt32},
                                                                         {"int32", kInt32},
                                                                         {"uint", kUint32},
                                                                         {"uint32", kUint32},
                                                                         {"float", kFloat32},
                                                                         {"float32", kFloat32},
                                                                         {"double", kFloat64},
                                                                         {"float64", kFloat64}}};
  for (const auto& [known, type] : kNames) {
    if (name == known) return type;
  }
  refuse_header("has a property of an unknown type");
}

Type pcd_type(std::string_view letter, std::size_t size) {
  using enum Type;
  if (letter == "F" && size == 4) return kFloat32;
  if (letter == "F" && size == 8) return kFloat64;
  if (letter == "U" && size == 1) return kUint8;
  if (letter == "U" && size == 2) return kUint16;
  if (letter == "U" && size == 4) return kUint32;
  if (letter == "I" && size == 1) return kInt8;
  if (letter == "I" && size == 2) return kInt16;
  if (letter == "I" && size == 4) return kInt32;
  refuse_header("has a field of an unknown type");
}

/// \param repeated numbers in the field that it begins
void add_column(Layout& layout, std::string_view name, Type type, std::size_t repeated = 1) {
  if (layout.columns.size() >= kMostColumns) refuse_header("has too many columns");
  layout.columns.push_back({std::string(name), type, layout.stride, repeated * size_of(type)});
  layout.stride += size_of(type);
}

/// Two sizes (bytes, packed and unpacked), and LZF.
std::string unpack(std::string_view bytes) {
  constexpr std::size_t kSizes = 8, kGrowth = 4;  // as in memory, with the tree
  const auto number = [&](std::size_t at) {
    std::size_t value = 0;
    for (std::size_t k = 4; k-- > 0;)
      value = 256 * value + static_cast<unsigned char>(bytes[at + k]);
    return value;
  };
  if (bytes.size() < kSizes) refuse_header("is truncated: without the size of its points");
  const std::size_t packed = number(0), size = number(4);
  bytes.remove_prefix(kSizes);
  if (packed > bytes.size()) {
    refuse_header("is truncated: " + std::to_string(bytes.size()) + " bytes of " +
                  std::to_string(packed));
  }
  if (size > kMostLzfGrowth * packed) refuse_header("is compressed, and damaged");
  check_memory("the compressed points", kGrowth * size);
  return unpack_lzf(bytes.substr(0, packed), size);
}

std::string join_words(const std::vector<std::string_view>& words, std::size_t from) {
  std::string text;
  for (std::size_t k = from; k < words.size(); ++k) {
    text += (text.empty() ? "" : " ") + std::string(words[k]);
  }
  return text;
}

}  // namespace

PointCloud parse_ply(std::string_view bytes) {
  Layout layout;
  std::map<int, std::string> names;
  std::optional<Layout::Encoding> encoding;
  std::string element;  // whose properties follow
  bool vertices = false;
  take_line(bytes);
  for (std::size_t lines = 0;; ++lines) {
    if (bytes.empty() || lines > kMostLines)
      refuse_header("is a PLY file without end of its header");
    const std::vector<std::string_view> words = words_of(take_line(bytes));
    if (words.empty()) continue;
    if (words[0] == "end_header") break;
    if (words[0] == "format" && words.size() >= 2) {
      if (words[1] == "ascii") encoding = Layout::Encoding::kText;
      if (words[1] == "binary_little_endian") encoding = Layout::Encoding::kLittleEndian;
      if (words[1] == "binary_big_endian") encoding = Layout::Encoding::kBigEndian;
    } else if (words[0] == "comment" && words.size() >= 4 && words[1] == "class") {
      if (const auto number = parse_int(words[2]); number && *number >= 0 && *number < 65536) {
        names[static_cast<int>(*number)] = join_words(words, 3);
      }
    } else if (words[0] == "element" && words.size() == 3) {
      element = words[1];
      if (element == "vertex") {
        layout.count = count_of(words[2]);
        vertices = true;
      } else if (!vertices && count_of(words[2]) > 0) {
        refuse_header("is a PLY file with elements before its points");
      }
    } else if (words[0] == "property" && element == "vertex") {
      if (words.size() != 3) refuse_header("is a PLY file with lists in its points");
      add_column(layout, words[2], ply_type(words[1]));
    }
  }
  if (!encoding) refuse_header("is a PLY file of an unknown format");
  if (!vertices) refuse_header("is a PLY file without points");
  layout.encoding = *encoding;
  PointCloud cloud = read_records(bytes, layout);
  cloud.class_name = std::move(names);
  return cloud;
}

PointCloud parse_pcd(std::string_view bytes) {
  Layout layout;
  std::vector<std::string> fields, types, sizes, counts;
  for (std::size_t lines = 0;; ++lines) {
    if (bytes.empty() || lines > kMostLines) refuse_header("is a PCD file without DATA");
    const std::vector<std::string_view> words = words_of(take_line(bytes));
    if (words.empty()) continue;
    const std::vector<std::string> values(words.begin() + 1, words.end());
    if (words[0] == "FIELDS") fields = values;
    if (words[0] == "TYPE") types = values;
    if (words[0] == "SIZE") sizes = values;
    if (words[0] == "COUNT") counts = values;
    if (words[0] == "POINTS" && words.size() == 2) layout.count = count_of(words[1]);
    if (words[0] != "DATA") continue;
    if (words.size() != 2) refuse_header("is a PCD file with DATA of an unknown kind");
    layout.by_field = words[1] == "binary_compressed";
    if (words[1] != "ascii" && words[1] != "binary" && !layout.by_field) {
      refuse_header("is a PCD file with DATA of an unknown kind");
    }
    if (words[1] != "ascii") layout.encoding = Layout::Encoding::kLittleEndian;
    break;
  }
  if (fields.size() != types.size() || fields.size() != sizes.size() ||
      (!counts.empty() && counts.size() != fields.size())) {
    refuse_header("is a PCD file whose FIELDS, SIZE, TYPE and COUNT differ in number");
  }
  for (std::size_t k = 0; k < fields.size(); ++k) {
    const std::size_t repeated = counts.empty() ? 1 : count_of(counts[k]);
    if (repeated > kMostColumns) refuse_header("has too many columns");
    for (std::size_t r = 0; r < repeated; ++r) {
      add_column(layout, r == 0 ? fields[k] : std::string(), pcd_type(types[k], count_of(sizes[k])),
                 r == 0 ? repeated : 1);
    }
  }
  return layout.by_field ? read_records(unpack(bytes), layout) : read_records(bytes, layout);
}

}  // namespace kys_slam::cloud_format
