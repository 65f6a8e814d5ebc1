// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <bit>
#include <cmath>
#include <random>

#include "map_evaluation.h"

namespace kys_slam {
namespace {

template <typename T>
void put(std::string& text, T value, bool swap = false) {
  auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if (swap) std::reverse(bytes.begin(), bytes.end());
  text.append(bytes.data(), bytes.size());
}

const std::string kColumns =
    "element vertex 2\nproperty uchar red\nproperty float x\nproperty double y\nproperty float z\n"
    "property int class\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n";

std::string binary_ply(bool big) {
  std::string text = "ply\nformat binary_" + std::string(big ? "big" : "little") +
                     "_endian 1.0\ncomment class 7 traffic light\n" + kColumns;
  for (const float x : {1.5F, -2.0F}) {
    put(text, std::uint8_t{200});
    put(text, x, big);
    put(text, 2.0 * x, big);
    put(text, 3 * x, big);
    put(text, std::int32_t{x > 0 ? 7 : -1}, big);
  }
  return text;
}

void expect_the_two(const PointCloud& cloud) {
  ASSERT_EQ(cloud.points.size(), 2U);
  EXPECT_EQ(cloud.points[0], Eigen::Vector3d(1.5, 3, 4.5));
  EXPECT_EQ(cloud.points[1], Eigen::Vector3d(-2, -4, -6));
}

TEST(PointCloud, IsReadFromEveryKindOfPly) {
  for (const bool big : {false, true}) {
    const PointCloud cloud = parse_point_cloud(binary_ply(big), "a.ply");
    expect_the_two(cloud);
    EXPECT_EQ(cloud.classes, (std::vector<int>{7, -1}));
    EXPECT_EQ(cloud.name_of_class(7), "traffic light");
    EXPECT_EQ(cloud.name_of_class(-1), "no class");
  }
  expect_the_two(parse_point_cloud(
      "ply\r\nformat ascii 1.0\r\n" + kColumns + "200 1.5 3 4.5 7\r\n200 -2 -4 -6 -1\r\n",
      "a.ply"));
}

/// Three numbers of something else for each of the two points, then the fields of these. Four bytes
/// and a copy of itself make the first 24, literal bytes the others.
std::string packed_fields() {
  std::string packed("\x03", 1);
  put(packed, 1.25F);
  packed += "\xe0\x0b\x03";  // 7 + 11 + 2 bytes, from 4 bytes back
  packed += "\x17";          // 24 literals
  for (const float x : {1.5F, -2.0F, 3.0F, -4.0F, 4.5F, -6.0F}) put(packed, x);
  return packed;
}

std::string compressed_pcd(const std::string& packed, std::uint32_t size) {
  std::string text =
      "# .PCD v0.7\nVERSION 0.7\nFIELDS other x y z\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 3 1 1 1\n"
      "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA binary_compressed\n";
  put(text, static_cast<std::uint32_t>(packed.size()));
  put(text, size);
  return text + packed;
}

std::string compressed_pcd() {
  return compressed_pcd(packed_fields(), 48);
}

TEST(PointCloud, IsReadFromPcdAndText) {
  const std::string head =
      "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z normal_x normal_y normal_z\nSIZE 4 4 4 4 4 4\n"
      "TYPE F F F F F F\nCOUNT 1 1 1 1 1 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\n";
  const PointCloud text = parse_point_cloud(
      head + "DATA ascii\n1.5 3 4.5 0 2 0\nnan nan nan nan nan nan\n-2 -4 -6 0 0 0\n", "a.pcd");
  expect_the_two(text);
  EXPECT_EQ(text.left_out, 1U) << "points without a measurement";
  EXPECT_EQ(text.normals[0], Eigen::Vector3d(0, 1, 0));
  EXPECT_TRUE(text.normals[1].isZero());
  std::string binary = head + "DATA binary\n";
  for (const float x : {1.5F, std::nanf(""), -2.0F}) {
    for (const float value : {x, 2 * x, 3 * x, 0.0F, 2.0F, 0.0F}) put(binary, value);
  }
  expect_the_two(parse_point_cloud(binary, "a.pcd"));
  expect_the_two(parse_point_cloud(compressed_pcd(), "a.pcd"));
  expect_the_two(parse_point_cloud("# x y z intensity\n1.5, 3, 4.5, 9\n\n-2 -4 -6\n", "a.xyz"));
}

TEST(PointCloud, WhatIsNoneIsNamed) {
  const auto refused = [](const std::string& bytes, const std::string& part) {
    try {
      parse_point_cloud(bytes, "cloud.ply");
      ADD_FAILURE() << "was read: " << part;
    } catch (const InputError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find(part), std::string::npos) << message;
      EXPECT_EQ(message.find("cloud.ply: "), 0U) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos);
    }
  };
  refused("", "no points");
  refused("# nothing\n", "no points");
  refused(std::string("\x01\x00\x02\x03", 4), "neither");
  refused("hello world\n", "too few numbers");
  refused("hello brave world\n", "no numbers");
  refused("1 2 3e9\n", "too far");
  refused("1 2 inf\n", "no numbers");
  refused("ply\nformat ascii 1.0\n", "end of its header");
  refused("ply\nformat ascii 1.0\nend_header\n", "without points");
  refused("ply\nformat binary 1.0\nelement vertex 1\nend_header\n", "unknown format");
  refused("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
          "no x, y, z");
  refused("ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n", "count");
  refused("ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n",
          "lists");
  refused("ply\nformat ascii 1.0\nelement face 3\nelement vertex 1\nend_header\n", "before");
  const std::string whole = binary_ply(false);
  refused(whole.substr(0, whole.size() - 1), "truncated");
  std::string huge = whole;
  huge.replace(huge.find("vertex 2"), 8, "vertex 999999999999999");
  refused(huge, "truncated");
  const std::string packed = compressed_pcd();
  refused(packed.substr(0, packed.size() - 1), "truncated");
  refused(packed.substr(0, packed.size() - 33), "truncated");
  refused(packed.substr(0, packed.size() - packed_fields().size() - 1), "size of its points");
  refused(compressed_pcd(packed_fields(), 47), "damaged");
  refused(compressed_pcd(packed_fields(), 49), "damaged");
  refused(compressed_pcd(packed_fields(), 0xffffffff), "damaged");
  refused(compressed_pcd(packed_fields().substr(0, 31), 48), "damaged");
  refused(compressed_pcd("", 0), "truncated");
  std::string behind = packed_fields();
  behind[7] = 4;  // five bytes back, of four
  refused(compressed_pcd(behind, 48), "damaged");
  refused(compressed_pcd(std::string("\xe0", 1), 48), "damaged");
  refused(compressed_pcd(packed_fields().substr(0, 8), 24), "truncated: 24 bytes for 2 points");
  refused("# .PCD v0.7\nFIELDS x y z\nSIZE 4 4\nTYPE F F F\nPOINTS 1\nDATA ascii\n",
          "differ in number");
  refused("# .PCD v0.7\nFIELDS x y z\nSIZE 4 4 3\nTYPE F F F\nPOINTS 1\nDATA ascii\n",
          "unknown type");
}

/// A floor and a wall, points 5 cm apart, classes 1 and 2.
PointCloud room(bool normals) {
  PointCloud cloud;
  cloud.class_name = {{1, "floor"}, {2, "wall"}};
  for (int i = 0; i < 100; ++i) {
    for (int j = 0; j < 60; ++j) {
      cloud.points.emplace_back(0.05 * i, 0.05 * j, 0);
      cloud.points.emplace_back(0.05 * i, 0, 0.05 * j + 1);
      if (normals) {
        cloud.normals.emplace_back(0, 0, 1);
        cloud.normals.emplace_back(0, 1, 0);
      }
      cloud.classes.insert(cloud.classes.end(), {1, 2});
    }
  }
  return cloud;
}

TEST(MapEvaluation, DistancesFromPlanesDoNotCountTheGaps) {
  EvaluatedMap map;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> at(0.5, 2.5);
  for (int k = 0; k < 500; ++k) {  // 3 cm above the floor, 8 cm before the wall
    const double x = at(random), y = at(random);
    map.cloud.points.emplace_back(x, y, 0.03);
    map.cloud.points.emplace_back(x, 0.08, y + 1);
    map.distance.insert(map.distance.end(), {5.0, 15.0});
  }
  const MapEvaluation planes = evaluate_map(map, room(true), {});
  EXPECT_NEAR(planes.spacing, 0.05, 1e-6);
  ASSERT_EQ(planes.map_by_class.size(), 2U);
  EXPECT_EQ(planes.map_by_class[0].name, "floor");
  EXPECT_NEAR(planes.map_by_class[0].median, 0.03, 1e-6);
  EXPECT_NEAR(planes.map_by_class[1].rmse, 0.08, 1e-6);
  EXPECT_EQ(planes.map_to_truth.count, 1000U);
  EXPECT_EQ(planes.map_to_truth.share, (std::array<double, 4>{0, 0.5, 1, 1}));
  EXPECT_NEAR(planes.by_distance[0].median, 0.03, 1e-6);
  EXPECT_NEAR(planes.by_distance[1].median, 0.08, 1e-6);
  EXPECT_EQ(planes.by_distance[2].count, 0U);
  // Without normals the gaps between the points count.
  const MapEvaluation points = evaluate_map(map, room(false), {});
  EXPECT_GT(points.map_by_class[0].median, 0.031);
  EXPECT_LT(points.map_by_class[0].median, std::hypot(0.03, 0.036));
}

TEST(MapEvaluation, CompletenessIsOfTheTruth) {
  PointCloud truth = room(true);
  EvaluatedMap map;
  for (std::size_t k = 0; k < truth.points.size(); ++k) {
    if (truth.classes[k] == 1) map.cloud.points.push_back(truth.points[k]);
  }
  const MapEvaluation e = evaluate_map(map, truth, {});
  EXPECT_EQ(e.map_to_truth.share[0], 1);
  EXPECT_EQ(e.truth_by_class[0].share[0], 1) << "the floor is there";
  EXPECT_EQ(e.truth_by_class[1].share[3], 0) << "the wall is 1 m above it";
  EXPECT_NEAR(e.truth_to_map.share[0], 0.5, 1e-9);
}

/// Along a straight line, where positions alone leave a turn about it open.
TEST(MapEvaluation, TrajectoriesAlignTheMap) {
  const PointCloud truth = room(true);
  const Rigid3 T_truth_map(so3_exp({0.3, -0.5, 0.8}), {10, -4, 2});
  EvaluatedMap map;
  EvaluateOptions options;
  for (const Eigen::Vector3d& p : truth.points) {
    map.cloud.points.push_back(T_truth_map.inverse() * p);
  }
  for (int k = 0; k < 5; ++k) {
    const Rigid3 T_truth_c(so3_exp({0.1, 0, 0}), Eigen::Vector3d(0.5 * k, 1, 1));
    options.trajectory_truth.push_back({0.1 * k, T_truth_c});
    map.keyframes.push_back({0.1 * k, T_truth_map.inverse() * T_truth_c});
  }
  const MapEvaluation e = evaluate_map(map, truth, options);
  EXPECT_EQ(e.map_to_truth.share[0], 1);
  EXPECT_LT((e.alignment.T.translation - T_truth_map.translation).norm(), 1e-6);
  options.trajectory_truth.resize(2);
  EXPECT_THROW(evaluate_map(map, truth, options), InputError) << "two poses";
}

TEST(MapEvaluation, IcpFindsAShiftAndATurn) {
  PointCloud truth = room(true);
  for (int i = 0; i < 60; ++i) {  // a third plane, without which a shift along x is open
    for (int j = 0; j < 60; ++j) {
      truth.points.emplace_back(0, 0.05 * i, 0.05 * j + 1);
      truth.normals.emplace_back(1, 0, 0);
      truth.classes.push_back(2);
    }
  }
  const Rigid3 T_off(so3_exp({0.01, -0.02, 0.015}), {0.08, 0.06, -0.05});
  EvaluatedMap map;
  for (std::size_t k = 0; k < truth.points.size(); k += 7) {
    map.cloud.points.push_back(T_off * truth.points[k]);
  }
  EvaluateOptions options;
  EXPECT_LT(evaluate_map(map, truth, options).map_to_truth.share[0], 0.7);
  options.icp = true;
  const MapEvaluation e = evaluate_map(map, truth, options);
  EXPECT_GT(e.map_to_truth.share[0], 0.99);
  EXPECT_LT(((e.alignment.T * T_off).translation).norm(), 0.01);
  for (Eigen::Vector3d& p : map.cloud.points) p.z() += 100;
  EXPECT_THROW(evaluate_map(map, truth, options), InputError) << "nothing within reach";
}

TEST(MapEvaluation, ItsPlyIsReadBackInTheFrameOfTheTruth) {
  EvaluatedMap map;
  map.cloud.points = {{1, 1, 0}, {1, 1, 0.5}};
  const MapEvaluation e = evaluate_map(map, room(true), {});
  const PointCloud cloud = parse_point_cloud(error_ply(map, e), "errors.ply");
  EXPECT_EQ(cloud.points, map.cloud.points);
}

}  // namespace
}  // namespace kys_slam
