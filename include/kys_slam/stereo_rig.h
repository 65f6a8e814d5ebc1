// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rectifier.h>

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace kys_slam {

/// Two raw cameras and their relative pose, as read from a calibration file.
struct StereoRig {
  RawCamera left;
  RawCamera right;
  std::string name;  ///< the file, for messages
  /// What to do when the lengths are in another unit, for messages.
  std::string unit_remedy = "lengths have to be in m";

  /// Distance between the two camera centres, m.
  [[nodiscard]] double baseline() const;
  /// The camera of the pair when it is rectified already: no distortion, parallel axes, equal
  /// intrinsics, shifted along x. Empty otherwise: use a StereoRectifier.
  [[nodiscard]] std::optional<StereoCamera> rectified() const;
  /// Sets the image size (px) when the calibration has none. \throws InputError when the
  /// calibration has another image size, or has none and principal points of another size, or when
  /// the baseline is not between 5 mm and 5 m.
  void set_image_size(int width, int height);
  /// \throws InputError when the baseline is not between 5 mm and 5 m.
  void check_baseline() const;
};

/// ROS's sensor_msgs/CameraInfo.
struct CameraInfo {
  int width = 0, height = 0;     ///< px
  std::string distortion_model;  ///< plumb_bob, rational_polynomial, equidistant, or ""
  std::vector<double> D;         ///< distortion
  std::array<double, 9> K{};     ///< of the raw image, row-major
  std::array<double, 9> R{};     ///< raw to rectified, row-major
  std::array<double, 12> P{};    ///< of the rectified image; P[3] = -fx baseline in the right one
  int binning_x = 0, binning_y = 0;  ///< pixels of the sensor per pixel; 0: 1
  /// Part of the sensor that images show, px; all 0: the whole sensor.
  struct Region {
    int x_offset = 0, y_offset = 0, width = 0, height = 0;
    friend bool operator==(const Region&, const Region&) = default;
  };
  Region roi;
};
/// The rig of the images as they are delivered: binned, of a region of interest.
/// \param width, height of these images, px; 0: not known
/// \throws InputError when the two are not a stereo pair (P[3] of the right camera must be
/// negative), all numbers are 0, or the size that is stated contradicts the region of interest.
StereoRig rig_from_camera_info(const CameraInfo& left, const CameraInfo& right,
                               const std::string& name, int width = 0, int height = 0);

/// Reads a calibration. One file: Kalibr's camchain (cam0 left, cam1 right), OpenCV's output of
/// stereoCalibrate (M1 D1 M2 D2 R T, or K1 .. with `image_size`), the stereo settings of ORB-SLAM2
/// and ORB-SLAM3, or our own:
///
///     left:  {width: 752, height: 480, fx: 458.7, fy: 457.3, cx: 367.2, cy: 248.4,   # px
///             model: radtan, distortion: [-0.28, 0.07, 0.0002, 0.00002]}  # or equidistant
///     right: {...}
///     T_left_right: [1, 0, 0, 0.11,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1]  # right to left, m
///
/// Two files: ROS camera_info of the left and the right camera, or OpenCV's intrinsics and
/// extrinsics. \param unit  m per unit of the file's lengths (0.001 for mm)
/// \throws InputError naming the file and what is missing or wrong, or that the format is unknown.
StereoRig read_stereo_rig(std::span<const std::filesystem::path> files, double unit = 1);

/// Our own YAML of a rig, lengths in m; read_stereo_rig reads it back.
/// \throws InputError when the size of the images is not known
std::string to_yaml(const StereoRig& rig);

}  // namespace kys_slam
