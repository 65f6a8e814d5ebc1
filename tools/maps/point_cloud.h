// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace kys_slam {

/// Points with what a file says of them.
struct PointCloud {
  std::vector<Eigen::Vector3d> points;    ///< m
  std::vector<Eigen::Vector3d> normals;   ///< one per point, of unit length or zero; or empty
  std::vector<int> classes;               ///< one per point, -1: none; or empty
  std::map<int, std::string> class_name;  ///< of those that the file names
  std::size_t left_out = 0;               ///< points whose coordinates are not finite

  [[nodiscard]] std::string name_of_class(int number) const;
};

/// Reads PLY (ASCII and binary; x, y, z, and nx, ny, nz, class when they are there), PCD (ASCII,
/// binary and compressed; x, y, z, normal_x.., label), or text with x, y, z at the beginning of
/// every line ("#": comment). The content tells which. \throws InputError naming the file:
/// unreadable, damaged, without points
PointCloud read_point_cloud(const std::filesystem::path& file);
/// The same in memory; `name` is used in messages.
PointCloud parse_point_cloud(std::string_view bytes, const std::string& name);

/// Columns of numbers in a record of a point cloud.
namespace cloud_format {

enum class Type { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
std::size_t size_of(Type type);

struct Column {
  std::string name;
  Type type = Type::kFloat32;
  std::size_t offset = 0;  ///< in a binary record
  std::size_t width = 0;   ///< bytes of the field that it begins
};
/// How the records of points follow each other.
struct Layout {
  enum class Encoding { kText, kLittleEndian, kBigEndian };
  Encoding encoding = Encoding::kText;
  std::vector<Column> columns;
  std::size_t stride = 0;  ///< bytes of a binary record
  bool by_field = false;   ///< binary: a field of all points, then the next field
  std::size_t count = 0;
};

/// \param data  what follows the header
/// \throws std::invalid_argument with what is wrong
PointCloud read_records(std::string_view data, const Layout& layout);
PointCloud parse_ply(std::string_view bytes);
PointCloud parse_pcd(std::string_view bytes);
/// The next line, without its end; `rest` begins behind it.
std::string_view take_line(std::string_view& rest);
std::vector<std::string_view> words_of(std::string_view line);

}  // namespace cloud_format

}  // namespace kys_slam
