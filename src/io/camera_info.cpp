// SPDX-License-Identifier: BSD-3-Clause
#include "io/camera_info.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "camera/plausible.h"

namespace kys_slam {

namespace {

RawCamera raw_camera(const CameraInfo& info, const std::string& name) {
  RawCamera camera;
  camera.width = info.width;
  camera.height = info.height;
  camera.fx = info.K[0], camera.cx = info.K[2], camera.fy = info.K[4], camera.cy = info.K[5];
  if (info.distortion_model != "none") camera.distortion = info.D;
  camera.lens = lens_of(info.distortion_model, camera.distortion, "distortion_model", name);
  drop_padding(camera.distortion, camera.lens);
  return camera;
}

/// The largest distance of the principal point from the middle, of half a side.
double off_centre(const CameraInfo& info) {
  return std::max(std::abs((2 * info.K[2] + 1) / info.width - 1),
                  std::abs((2 * info.K[5] + 1) / info.height - 1));
}

/// K and P of the pixels that a region of interest and binning leave.
CameraInfo cut(CameraInfo info, const CameraInfo::Region& roi, int bin_x, int bin_y) {
  info.K[0] /= bin_x, info.K[2] = (info.K[2] - roi.x_offset) / bin_x;
  info.K[4] /= bin_y, info.K[5] = (info.K[5] - roi.y_offset) / bin_y;
  info.P[0] /= bin_x, info.P[2] = (info.P[2] - roi.x_offset) / bin_x, info.P[3] /= bin_x;
  info.P[5] /= bin_y, info.P[6] = (info.P[6] - roi.y_offset) / bin_y, info.P[7] /= bin_y;
  info.width = roi.width / bin_x;
  info.height = roi.height / bin_y;
  return info;
}

/// The calibration of the images that are delivered. By ROS's definition K and P are of the whole
/// sensor, whose size is width x height, and images are its region of interest, binned. Some
/// drivers state the size of the images instead, with K and P of either: then the principal point
/// decides. \param width, height of the images, px; 0: not known
CameraInfo of_images(const CameraInfo& info, int width, int height, const std::string& name) {
  const int bin_x = std::max(1, info.binning_x), bin_y = std::max(1, info.binning_y);
  CameraInfo::Region roi = info.roi;
  if (roi.width <= 0 || roi.height <= 0) roi = {0, 0, info.width, info.height};
  const bool whole = roi == CameraInfo::Region{0, 0, info.width, info.height};
  if (whole && bin_x == 1 && bin_y == 1) return info;
  if (roi.x_offset < 0 || roi.y_offset < 0) throw InputError(name + ": a negative offset in roi");
  const CameraInfo images = cut(info, roi, bin_x, bin_y);
  const bool inside = std::int64_t{roi.x_offset} + roi.width <= info.width &&
                      std::int64_t{roi.y_offset} + roi.height <= info.height;
  if (inside && (width != info.width || height != info.height)) return images;
  CameraInfo same_size = images;
  same_size.width = info.width;
  same_size.height = info.height;
  constexpr double kCentred = 0.25;
  const double as_stated = off_centre(info), as_cut = off_centre(same_size);
  if (as_stated < kCentred && as_cut > 2 * kCentred) return info;
  if (as_cut < kCentred && as_stated > 2 * kCentred) return same_size;
  throw InputError(fmt::format(
      "{}: camera_info has a size of {}x{} px, a region of interest of {}x{} at ({}, {}) "
      "and binning {}x{}; of which of these K is cannot be told; give --calibration FILE",
      name, info.width, info.height, roi.width, roi.height, roi.x_offset, roi.y_offset, bin_x,
      bin_y));
}

}  // namespace

CameraInfo read_camera_info(const CalibrationFile& file) {
  CameraInfo info;
  const YAML::Node& root = file.root();
  const bool saved = file.has("camera_matrix");  // by camera_calibration; else an echoed message
  const auto key = [&](const char* in_file, const char* upper, const char* lower) {
    return std::string(saved ? in_file : file.has(upper) ? upper : lower);
  };
  const auto matrix = [&](const std::string& name, auto& out) {
    const auto values = file.numbers(root[name], name);
    if (values.size() != out.size()) file.fail("'" + name + "' has the wrong size");
    std::copy(values.begin(), values.end(), out.begin());
  };
  const char* w = saved ? "image_width" : "width";
  const char* h = saved ? "image_height" : "height";
  info.width = file.side(file.number(root, w), w);
  info.height = file.side(file.number(root, h), h);
  info.distortion_model = word(root["distortion_model"]);
  const std::string d = key("distortion_coefficients", "D", "d");
  info.D = file.numbers(root[d], d);
  matrix(key("camera_matrix", "K", "k"), info.K);
  matrix(key("rectification_matrix", "R", "r"), info.R);
  matrix(key("projection_matrix", "P", "p"), info.P);
  const auto count = [&](const YAML::Node& node, const char* name) {
    return node && node.IsMap() && node[name] ? static_cast<int>(file.number(node, name)) : 0;
  };
  info.binning_x = count(root, "binning_x");
  info.binning_y = count(root, "binning_y");
  info.roi = {count(root["roi"], "x_offset"), count(root["roi"], "y_offset"),
              count(root["roi"], "width"), count(root["roi"], "height")};
  return info;
}

bool is_camera_info(const CalibrationFile& file) {
  return file.has("camera_matrix") || (file.has("K") && file.has("P")) ||
         (file.has("k") && file.has("p"));
}

StereoRig rig_from_camera_info(const CameraInfo& left, const CameraInfo& right,
                               const std::string& name, int width, int height) {
  for (const CameraInfo* info : {&left, &right}) {
    if (info->K[0] != 0 || info->P[0] != 0) continue;
    throw InputError(name +
                     ": camera_info is all zeros, the driver has no calibration; give "
                     "--calibration FILE");
  }
  const CameraInfo l = of_images(left, width, height, name);
  const CameraInfo r = of_images(right, width, height, name);
  StereoRig rig{raw_camera(l, name), raw_camera(r, name), name};
  rig.unit_remedy = "P[3] of the right camera is -fx * baseline, px m; give --calibration FILE";
  if (!(r.P[0] > 0) || !std::isfinite(r.P[3])) {
    throw InputError(name + ": the right camera's P is not that of a rectified camera");
  }
  const double shift = r.P[3] / r.P[0] - (l.P[0] > 0 ? l.P[3] / l.P[0] : 0);
  if (!(shift < 0)) {
    throw InputError(name + ": the right camera's P[3] is " + std::to_string(r.P[3]) +
                     ", not negative: no stereo calibration, or left and right are swapped");
  }
  if (-shift < kLeastBaseline && -r.P[3] >= kLeastBaseline && -r.P[3] <= kMostBaseline) {
    throw InputError(
        fmt::format("{}: the right camera's P[3] is {:g}: a baseline of {:g} m, since P[3] is -fx "
                    "* baseline. Is "
                    "it the baseline in m? Give --calibration FILE",
                    name, r.P[3], -shift));
  }
  // x_rectified = R x_raw in both; the right rectified camera sees x - baseline.
  const auto rotation = [&](const std::array<double, 9>& R) {
    const std::vector<double> rows{R[0], R[1], R[2], 0, R[3], R[4], R[5], 0, R[6], R[7], R[8], 0};
    const auto T = rigid_from_row_major(rows.data());
    if (!T) throw InputError(name + ": R is not a rotation");
    return *T;
  };
  const Rigid3 T_shift(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-shift, 0, 0));
  rig.right.T_b_s = rotation(l.R).inverse() * T_shift * rotation(r.R);
  return rig;
}

}  // namespace kys_slam
