// SPDX-License-Identifier: BSD-3-Clause
#include <kys/portable_math.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/text_table.h>

#include <array>
#include <cmath>
#include <numbers>

#include "io/sequence_parts.h"

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

/// A rotation (9 numbers) or a pose (12), named by the first of `names` that the file has.
Rigid3 read_rigid(const fs::path& calibration, const std::vector<std::string>& names,
                  std::size_t count) {
  const std::vector<double> v = kitti_calibration_row(calibration, names, count);
  const std::size_t columns = count / 3;
  std::array<double, 12> rows{};
  for (std::size_t i = 0; i < count; ++i) rows[i / columns * 4 + i % columns] = v[i];
  const auto pose = rigid_from_row_major(rows.data());
  if (!pose) throw InputError(calibration.string() + ": " + names.front() + " is no rotation");
  return *pose;
}

/// Left camera (camera 2) to inertial unit, from the calibration file.
Rigid3 read_T_imu_cam2(const fs::path& calibration) {
  const Rigid3 T_rect_cam = read_rigid(calibration, {"R_rect", "R0_rect"}, 9);
  const Rigid3 T_cam_velo = read_rigid(calibration, {"Tr_velo_cam", "Tr_velo_to_cam"}, 12);
  const Rigid3 T_velo_imu = read_rigid(calibration, {"Tr_imu_velo", "Tr_imu_to_velo"}, 12);
  const auto P2 = kitti_projection(calibration, "P2");
  const Rigid3 T_cam2_cam0(Eigen::Quaterniond::Identity(),
                           Eigen::Vector3d(P2(0, 3) / P2(0, 0), 0, 0));
  return (T_cam2_cam0 * T_rect_cam * T_cam_velo * T_velo_imu).inverse();
}

/// One OXTS packet as a pose over the Mercator plane touching at the first packet's latitude.
Rigid3 oxts_pose(const std::vector<double>& packet, double scale) {
  constexpr double kEarthRadius = 6378137.0;  // m
  constexpr double kDegree = std::numbers::pi / 180.0;
  const double latitude = packet[0], longitude = packet[1], altitude = packet[2];
  const Eigen::Vector3d t(
      scale * kEarthRadius * longitude * kDegree,
      scale * kEarthRadius *
          kys::portable::log(kys::portable::tan((90.0 + latitude) * kDegree / 2.0)),
      altitude);
  const Eigen::Quaterniond q = Eigen::AngleAxisd(packet[5], Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(packet[4], Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(packet[3], Eigen::Vector3d::UnitX());
  return {q, t};
}

std::vector<TimedPose> read_oxts(const fs::path& file, const fs::path& calibration,
                                 const NamedPairs& pairs) {
  const Rigid3 T_imu_c = read_T_imu_cam2(calibration);
  const TextTable table(file);
  std::vector<TimedPose> poses;
  double scale = 0;
  for (std::size_t i = 0; i < pairs.frames.size(); ++i) {
    const TextRow& row = table.rows()[pairs.row_of(i, table.rows().size(), file, "rows")];
    const std::vector<double> packet = table.numbers(row);
    if (packet.size() < 6) table.fail(row, "too few columns");
    if (std::abs(packet[0]) >= 90 || std::abs(packet[1]) > 360) {
      table.fail(row, "no such latitude and longitude");
    }
    if (i == 0) scale = kys::portable::cos(packet[0] * std::numbers::pi / 180.0);
    poses.push_back({pairs.frames[i].timestamp, oxts_pose(packet, scale) * T_imu_c});
  }
  make_relative_to_first(poses);
  return poses;
}

}  // namespace

std::unique_ptr<Sequence> open_kitti_tracking(const fs::path& folder,
                                              const SequenceOptions& options) {
  const std::string name = folder.filename().string();
  const fs::path root = folder.parent_path().parent_path();
  Sequence::Content content;
  content.name = name;
  content.layout = "KITTI Tracking";
  const fs::path calibration = root / "calib" / (name + ".txt");
  if (!path_exists(calibration)) throw InputError(calibration.string() + ": no such file");
  NamedPairs pairs = pair_by_name(folder, root / "image_03" / name);
  for (std::size_t i = 0; i < pairs.frames.size(); ++i) {
    pairs.frames[i].timestamp = pairs.time_of(i, kFrameRate);
  }
  content.camera = kitti_camera(calibration, "P2", "P3", pairs.frames.front().left);
  const fs::path oxts = root / "oxts" / (name + ".txt");
  if (path_exists(oxts)) content.ground_truth = read_oxts(oxts, calibration, pairs);
  content.dropped = pairs.dropped;
  content.frames = std::move(pairs.frames);
  return make_sequence(std::move(content), options, folder);
}

}  // namespace kys_slam
