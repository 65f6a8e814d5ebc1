// SPDX-License-Identifier: BSD-3-Clause
#include "point_cloud.h"

#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>

namespace kys_slam {

namespace {

constexpr double kMostMetres = 1e8;  // of a coordinate
constexpr std::size_t kMostBytes = std::size_t{1} << 32;

[[noreturn]] void refuse(const std::string& what) {
  throw std::invalid_argument(what);
}

template <typename T>
double number_at(const char* at, bool swap) {
  std::array<char, sizeof(T)> bytes{};
  std::memcpy(bytes.data(), at, sizeof(T));
  if (swap) std::reverse(bytes.begin(), bytes.end());
  return static_cast<double>(std::bit_cast<T>(bytes));
}

double number_at(const char* at, cloud_format::Type type, bool swap) {
  using enum cloud_format::Type;
  switch (type) {
    case kInt8:
      return number_at<std::int8_t>(at, swap);
    case kUint8:
      return number_at<std::uint8_t>(at, swap);
    case kInt16:
      return number_at<std::int16_t>(at, swap);
    case kUint16:
      return number_at<std::uint16_t>(at, swap);
    case kInt32:
      return number_at<std::int32_t>(at, swap);
    case kUint32:
      return number_at<std::uint32_t>(at, swap);
    case kFloat32:
      return number_at<float>(at, swap);
    case kFloat64:
      break;
  }
  return number_at<double>(at, swap);
}

/// Which columns hold what; -1: none does.
struct Wanted {
  std::array<int, 3> position{-1, -1, -1}, normal{-1, -1, -1};
  int label = -1;

  explicit Wanted(const std::vector<cloud_format::Column>& columns) {
    const auto find = [&](std::initializer_list<std::string_view> names) {
      for (std::size_t k = 0; k < columns.size(); ++k) {
        for (const std::string_view name : names) {
          if (columns[k].name == name) return static_cast<int>(k);
        }
      }
      return -1;
    };
    position = {find({"x"}), find({"y"}), find({"z"})};
    normal = {find({"nx", "normal_x"}), find({"ny", "normal_y"}), find({"nz", "normal_z"})};
    label = find({"class", "label"});
    if (*std::min_element(position.begin(), position.end()) < 0) refuse("has no x, y, z");
  }
  [[nodiscard]] bool normals() const {
    return *std::min_element(normal.begin(), normal.end()) >= 0;
  }
};

/// Adds a point by its record. \param value  number of a column
template <typename Value>
void add_point(const Wanted& wanted, const Value& value, PointCloud& cloud) {
  Eigen::Vector3d p, n;
  for (std::size_t c = 0; c < 3; ++c)
    p[static_cast<Eigen::Index>(c)] = value(wanted.position.at(c));
  if (!p.allFinite()) {
    ++cloud.left_out;
    return;
  }
  if (p.cwiseAbs().maxCoeff() > kMostMetres) refuse("has a point that is too far away");
  cloud.points.push_back(p);
  if (wanted.normals()) {
    for (std::size_t c = 0; c < 3; ++c)
      n[static_cast<Eigen::Index>(c)] = value(wanted.normal.at(c));
    const double norm = n.norm();
    const bool sound = std::isfinite(norm) && norm > 1e-6;
    cloud.normals.emplace_back(sound ? Eigen::Vector3d(n / norm) : Eigen::Vector3d::Zero());
  }
  if (wanted.label >= 0) {
    const double label = value(wanted.label);
    cloud.classes.push_back(label >= 0 && label < 1e9 ? static_cast<int>(label) : -1);
  }
}

/// Positions in every line.
PointCloud parse_text(std::string_view bytes) {
  cloud_format::Layout layout;
  for (const char* name : {"x", "y", "z"}) layout.columns.push_back({name, {}, 0});
  for (std::string_view rest = bytes; !rest.empty();) {
    if (!cloud_format::words_of(cloud_format::take_line(rest)).empty()) ++layout.count;
  }
  return cloud_format::read_records(bytes, layout);
}

}  // namespace

namespace cloud_format {

std::size_t size_of(Type type) {
  constexpr std::array<std::size_t, 8> kSizes = {1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes.at(static_cast<std::size_t>(type));
}

std::string_view take_line(std::string_view& rest) {
  const std::size_t end = rest.find('\n');
  std::string_view line = rest.substr(0, end);
  rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::vector<std::string_view> words_of(std::string_view line) {
  constexpr std::string_view kBlanks = " \t,;";
  std::vector<std::string_view> words;
  line = line.substr(0, line.find('#'));
  while (true) {
    const std::size_t begin = line.find_first_not_of(kBlanks);
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    words.push_back(line.substr(0, line.find_first_of(kBlanks)));
    line.remove_prefix(words.back().size());
  }
}

PointCloud read_records(std::string_view data, const Layout& layout) {
  const Wanted wanted(layout.columns);
  PointCloud cloud;
  if (layout.encoding != Layout::Encoding::kText) {
    if (layout.stride == 0 || layout.count > data.size() / layout.stride) {
      refuse("is truncated: " + std::to_string(data.size()) + " bytes for " +
             std::to_string(layout.count) + " points of " + std::to_string(layout.stride));
    }
    const bool swap = (layout.encoding == Layout::Encoding::kBigEndian) !=
                      (std::endian::native == std::endian::big);
    for (std::size_t k = 0; k < layout.count; ++k) {
      add_point(
          wanted,
          [&](int column) {
            const Column& c = layout.columns[static_cast<std::size_t>(column)];
            const std::size_t at = layout.by_field ? c.offset * layout.count + k * c.width
                                                   : k * layout.stride + c.offset;
            return number_at(data.data() + at, c.type, swap);
          },
          cloud);
    }
    return cloud;
  }
  std::size_t line_number = 0;
  for (std::size_t k = 0; k < layout.count;) {
    if (data.empty())
      refuse("is truncated: " + std::to_string(k) + " points of " + std::to_string(layout.count));
    const std::vector<std::string_view> words = words_of(take_line(data));
    ++line_number;
    if (words.empty()) continue;
    if (words.size() < layout.columns.size()) {
      refuse("line " + std::to_string(line_number) + " of its points has too few numbers");
    }
    const auto value = [&](int column) {
      const std::string_view word = words[static_cast<std::size_t>(column)];
      if (const auto number = parse_double(word)) return *number;
      if (word == "nan" || word == "NaN" || word == "-nan") return std::nan("");
      refuse("line " + std::to_string(line_number) + " of its points has no numbers");
    };
    add_point(wanted, value, cloud);
    ++k;
  }
  return cloud;
}

}  // namespace cloud_format

std::string PointCloud::name_of_class(int number) const {
  if (number < 0) return "no class";
  const auto found = class_name.find(number);
  return found == class_name.end() ? "class " + std::to_string(number) : found->second;
}

PointCloud parse_point_cloud(std::string_view bytes, const std::string& name) {
  try {
    PointCloud cloud;
    if (bytes.starts_with("ply\n") || bytes.starts_with("ply\r")) {
      cloud = cloud_format::parse_ply(bytes);
    } else if (bytes.starts_with("# .PCD") || bytes.starts_with("VERSION")) {
      cloud = cloud_format::parse_pcd(bytes);
    } else {
      if (bytes.substr(0, 4096).find('\0') != std::string_view::npos) {
        refuse("is neither PLY nor PCD nor text with x, y, z");
      }
      cloud = parse_text(bytes);
    }
    if (cloud.points.empty()) refuse("holds no points");
    return cloud;
  } catch (const std::invalid_argument& error) {
    throw InputError(name + ": " + error.what());
  }
}

PointCloud read_point_cloud(const std::filesystem::path& file) {
  const std::string bytes = read_text(file, kMostBytes);
  constexpr std::size_t kGrowth = 4;  // as numbers of double precision, with the tree
  check_memory(file.string(), kGrowth * bytes.size());
  return parse_point_cloud(bytes, file.string());
}

}  // namespace kys_slam
