// SPDX-License-Identifier: BSD-3-Clause
// make_sequence FOLDER: the frames along the wall as a sequence in KITTI's layout, and the same
// camera as a raw one in Kalibr's format (FOLDER/camchain.yaml).
#include <kys_slam/image_file.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

#include "wall.h"

namespace {

namespace fs = std::filesystem;

void write_calibration(const fs::path& folder) {
  const kys_slam::StereoCamera& c = wall::kCamera;
  std::ofstream kitti(folder / "calib.txt");
  for (const double shift : {0.0, -c.fx * c.baseline}) {
    kitti << (shift == 0 ? "P0: " : "P1: ") << c.fx << " 0 " << c.cx << " " << shift << " 0 "
          << c.fy << " " << c.cy << " 0 0 0 1 0\n";
  }
  std::ofstream kalibr(folder / "camchain.yaml");
  for (int k = 0; k < 2; ++k) {
    kalibr << "cam" << k << ":\n  camera_model: pinhole\n  intrinsics: [" << c.fx << ", " << c.fy
           << ", " << c.cx << ", " << c.cy << "]\n  distortion_model: radtan\n"
           << "  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [" << c.width << ", " << c.height
           << "]\n";
  }
  kalibr << "  T_cn_cnm1:\n  - [1, 0, 0, " << -c.baseline
         << "]\n  - [0, 1, 0, 0]\n  - [0, 0, 1, 0]\n  - [0, 0, 0, 1]\n";
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const fs::path folder = argv[1];
  fs::create_directories(folder / "image_0");
  fs::create_directories(folder / "image_1");
  write_calibration(folder);
  std::ofstream times(folder / "times.txt");
  std::ofstream poses(folder / "poses.txt");
  for (int i = 0; i < wall::kFrames; ++i) {
    const kys_slam::StereoFrame frame = wall::grab(i);
    char name[16];
    std::snprintf(name, sizeof name, "%06d.png", i);
    kys_slam::write_png(folder / "image_0" / name, frame.left);
    kys_slam::write_png(folder / "image_1" / name, frame.right);
    const Eigen::Vector3d p = wall::position(i);
    times << frame.timestamp << "\n";
    poses << "1 0 0 " << p.x() << " 0 1 0 " << p.y() << " 0 0 1 " << p.z() << "\n";
  }
  return times && poses ? 0 : 1;
}
