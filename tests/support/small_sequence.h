// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>
#include <kys_slam/image_file.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "io/temporary_folder.h"
#include "support/rendered_corridor.h"

namespace kys_slam::testing {

inline constexpr int kSmallFrames = 12;

inline StereoCamera small_camera() {
  return {400, 122, 232, 232, 199.5, 60.5, 0.537};
}

inline std::string image_name(int i) {
  return fmt::format("{:06d}.png", i);
}

inline Rigid3 small_pose(int i) {
  return {so3_exp({0, 0.01 * std::sin(0.5 * i), 0}), Eigen::Vector3d(0.02 * i, 0, 0.5 * i)};
}

inline void write_small_sequence(const std::filesystem::path& folder) {
  const StereoCamera camera = small_camera();
  const RenderedCorridor corridor(camera, 12);
  std::filesystem::create_directories(folder / "image_0");
  std::filesystem::create_directories(folder / "image_1");
  std::string times;
  std::string poses;
  for (int i = 0; i < kSmallFrames; ++i) {
    const StereoFrame frame = corridor.look(i, small_pose(i));
    write_png(folder / "image_0" / image_name(i), frame.left);
    write_png(folder / "image_1" / image_name(i), frame.right);
    times += fmt::format("{:.6f}\n", frame.timestamp);
    const Eigen::Matrix<double, 3, 4> M = (small_pose(0).inverse() * small_pose(i)).matrix();
    for (int k = 0; k < 12; ++k)
      poses += fmt::format("{}{:.9g}", k > 0 ? " " : "", M(k / 4, k % 4));
    poses += "\n";
  }
  const auto row = [&](const char* name, double x) {
    return fmt::format("{}: {} 0 {} {} 0 {} {} 0 0 0 1 0\n", name, camera.fx, camera.cx, x,
                       camera.fy, camera.cy);
  };
  write_text(folder / "calib.txt", row("P0", 0) + row("P1", -camera.bf()));
  write_text(folder / "times.txt", times);
  write_text(folder / "poses.txt", poses);
}

/// A rendered KITTI odometry sequence of twelve frames with ground truth. Rendered by the first
/// test that asks, kept in the build folder for the others (each runs in a process of its own).
inline std::filesystem::path small_sequence() {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(KYS_BINARY_DIR) / "tests" / "small_sequence_v1";
  if (fs::exists(folder)) return folder;
  fs::create_directories(folder.parent_path());
  const TemporaryFolder work;
  write_small_sequence(work.path() / "seq");
  // Complete or not at all, also when two tests do this at the same time: then the second loses.
  std::error_code failed;
  const fs::path beside = folder.string() + "." + work.path().filename().string();
  fs::copy(work.path() / "seq", beside, fs::copy_options::recursive);
  fs::rename(beside, folder, failed);
  if (failed) fs::remove_all(beside);
  return folder;
}

/// A copy of the small sequence to be spoilt by a test.
inline void copy_small_sequence(const std::filesystem::path& to) {
  std::filesystem::create_directories(to.parent_path());
  std::filesystem::copy(small_sequence(), to, std::filesystem::copy_options::recursive);
}

}  // namespace kys_slam::testing
