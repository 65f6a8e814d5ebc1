// SPDX-License-Identifier: BSD-3-Clause
#include "rig_formats.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <kys_slam/error.h>

#include <Eigen/Core>
#include <span>
#include <vector>

namespace kys_slam {

namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

std::string numbers(std::span<const double> values) {
  return fmt::format("[{}]", fmt::join(values, ", "));  // as few digits as give them back
}

std::array<double, 9> matrix_of(const RawCamera& c) {
  return {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1};
}

std::string opencv_matrix(const std::string& name, int rows, std::span<const double> values) {
  const auto columns = static_cast<int>(values.size()) / rows;
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: {}\n", name,
                     rows, columns, numbers(values));
}

std::string kalibr_camera(const RawCamera& c) {
  const bool fisheye = c.lens == LensModel::kEquidistant;
  const std::array intrinsics = {c.fx, c.fy, c.cx, c.cy};
  return fmt::format(
      "  camera_model: pinhole\n  distortion_model: {}\n  intrinsics: {}\n"
      "  distortion_coeffs: {}\n  resolution: [{}, {}]\n",
      fisheye ? "equidistant" : "radtan", numbers(intrinsics), numbers(c.distortion), c.width,
      c.height);
}

std::string camera_info(const RawCamera& c, const StereoCamera& rectified,
                        const RowMajor3& R_rectified_raw, double shift) {
  const auto matrix = [](const char* name, int rows, int columns, const std::string& data) {
    return fmt::format("{}:\n  rows: {}\n  cols: {}\n  data: {}\n", name, rows, columns, data);
  };
  const StereoCamera& k = rectified;
  const std::array P = {k.fx, 0.0, k.cx, shift, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0};
  const auto count = static_cast<int>(c.distortion.size());
  return fmt::format("image_width: {}\nimage_height: {}\n", c.width, c.height) +
         matrix("camera_matrix", 3, 3, numbers(matrix_of(c))) +
         fmt::format("distortion_model: {}\n",
                     c.lens == LensModel::kEquidistant ? "equidistant" : "plumb_bob") +
         matrix("distortion_coefficients", 1, count, numbers(c.distortion)) +
         matrix("rectification_matrix", 3, 3, numbers({R_rectified_raw.data(), 9})) +
         matrix("projection_matrix", 3, 4, numbers(P));
}

}  // namespace

std::string to_opencv(const StereoRig& rig) {
  if (rig.left.lens == LensModel::kEquidistant || rig.right.lens == LensModel::kEquidistant) {
    throw InputError(rig.name + ": OpenCV's stereo calibration has no equidistant lenses");
  }
  const Rigid3 T_r_l = rig.right.T_b_s.inverse() * rig.left.T_b_s;
  const RowMajor3 R = T_r_l.R();
  const auto lens = [](const RawCamera& c) {
    return c.distortion.empty() ? std::vector<double>(4, 0.0) : c.distortion;
  };
  return fmt::format("%YAML:1.0\n---\nimage_size: [{}, {}]\n", rig.left.width, rig.left.height) +
         opencv_matrix("M1", 3, matrix_of(rig.left)) + opencv_matrix("D1", 1, lens(rig.left)) +
         opencv_matrix("M2", 3, matrix_of(rig.right)) + opencv_matrix("D2", 1, lens(rig.right)) +
         opencv_matrix("R", 3, {R.data(), 9}) + opencv_matrix("T", 3, {T_r_l.t().data(), 3});
}

std::string to_kalibr(const StereoRig& rig) {
  const Rigid3 T_r_l = rig.right.T_b_s.inverse() * rig.left.T_b_s;
  const Eigen::Matrix<double, 3, 4> T = T_r_l.matrix();
  std::string text = "cam0:\n" + kalibr_camera(rig.left) + "cam1:\n  T_cn_cnm1:\n";
  for (int r = 0; r < 3; ++r) {
    text += fmt::format("  - [{}, {}, {}, {}]\n", T(r, 0), T(r, 1), T(r, 2), T(r, 3));
  }
  return text + "  - [0.0, 0.0, 0.0, 1.0]\n" + kalibr_camera(rig.right);
}

std::array<std::string, 2> to_camera_info(const StereoRig& rig) {
  const StereoRectifier rectifier(rig.left, rig.right, rig.name);
  const StereoCamera& camera = rectifier.camera();
  const Eigen::Matrix3d R_c_b = rectifier.T_b_c().R().transpose();
  return {camera_info(rig.left, camera, R_c_b * rig.left.T_b_s.R(), 0),
          camera_info(rig.right, camera, R_c_b * rig.right.T_b_s.R(), -camera.bf())};
}

}  // namespace kys_slam
