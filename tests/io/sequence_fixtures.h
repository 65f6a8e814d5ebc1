// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_file.h>

#include <cstdio>
#include <string>

#include "temporary_folder.h"

namespace kys_slam {

inline const char* const kKittiCalibration =
    "P0: 700 0 30 0 0 700 20 0 0 0 1 0\n"
    "P1: 700 0 30 -350 0 700 20 0 0 0 1 0\n"
    "P2: 700 0 30 42 0 700 20 0 0 0 1 0\n"
    "P3: 700 0 30 -308 0 700 20 0 0 0 1 0\n";

inline std::string numbered(const char* format, int i) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, format, i);
  return buffer;
}

inline void write_images(const std::filesystem::path& folder, const char* format, int count,
                         int shade) {
  std::filesystem::create_directories(folder);
  for (int i = 0; i < count; ++i) {
    write_png(folder / numbered(format, i),
              GrayImage(60, 40, static_cast<std::uint8_t>(shade + i)));
  }
}

/// A KITTI odometry folder of five frames that drive one metre each.
inline void write_kitti_odometry(const std::filesystem::path& folder, const char* left = "image_0",
                                 const char* right = "image_1") {
  write_images(folder / left, "%06d.png", 5, 10);
  write_images(folder / right, "%06d.png", 5, 100);
  write_text(folder / "calib.txt", kKittiCalibration);
  write_text(folder / "times.txt", "0\n0.1\n0.2\n0.3\n0.4\n");
  std::string poses;
  for (int i = 0; i < 5; ++i) poses += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(i) + "\n";
  write_text(folder / "poses.txt", poses);
}

inline std::string sensor_yaml(const std::string& y, const std::string& intrinsics) {
  return "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
         "  data: [0.0, -1.0, 0.0, 0.0,\n         1.0, 0.0, 0.0, " +
         y +
         ",\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n"
         "resolution: [60, 40]\ncamera_model: pinhole\nintrinsics: [" +
         intrinsics +
         "]\ndistortion_model: radial-tangential\n"
         "distortion_coefficients: [-0.1, 0.01, 0.0, 0.0]\n";
}

/// An EuRoC folder; the left camera lacks the third stamp, the right one the fifth.
inline void write_euroc(const std::filesystem::path& folder) {
  for (int camera = 0; camera < 2; ++camera) {
    const auto mav = folder / "mav0" / ("cam" + std::to_string(camera));
    std::string csv = "#timestamp [ns],filename\r\n";
    for (int i = 0; i < 6; ++i) {
      if (i == (camera == 0 ? 2 : 4)) continue;
      // the right camera is a microsecond late
      const std::string stamp =
          std::to_string(1403715273262142976 + 50000000LL * i + 1000 * camera);
      std::filesystem::create_directories(mav / "data");
      write_png(mav / "data" / (stamp + ".png"), GrayImage(60, 40, std::uint8_t(50 + i)));
      csv += stamp + "," + stamp + ".png\r\n";
    }
    write_text(mav / "data.csv", csv);
    write_text(mav / "sensor.yaml",
               sensor_yaml(camera == 0 ? "0.0" : "0.1", "50.0, 50.0, 29.5, 19.5"));
  }
  write_text(folder / "mav0/state_groundtruth_estimate0/data.csv",
             "#timestamp, ...\n1403715273262142976,1,2,3,1,0,0,0,0,0,0,0,0,0,0,0,0\n"
             "1403715273267142976,1.5,2,3,1,0,0,0,0,0,0,0,0,0,0,0,0\n");
}

}  // namespace kys_slam
