// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/portable_math.h>
#include <kys_slam/error.h>
#include <kys_slam/stereo_rig.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <utility>

#include "camera/plausible.h"
#include "io/calibration_file.h"
#include "io/camera_info.h"
#include "io/orb_slam_settings.h"
#include "io/yaml_file.h"

namespace kys_slam {

namespace fs = std::filesystem;

namespace {

/// cam0, cam1 of a Kalibr camchain.
RawCamera kalibr_camera(const CalibrationFile& file, const char* key) {
  const YAML::Node node = file.root()[key];
  if (!node.IsMap()) file.fail(std::string("'") + key + "' is no camera");
  RawCamera camera;
  file.read_pinhole(node, std::string(key) + ": ", camera);
  return camera;
}

StereoRig read_kalibr(const CalibrationFile& file, double unit) {
  if (!file.has("cam1")) file.fail("a camchain of one camera: no 'cam1'");
  StereoRig rig{kalibr_camera(file, "cam0"), kalibr_camera(file, "cam1"), file.name()};
  const YAML::Node cam0 = file.root()["cam0"], cam1 = file.root()["cam1"];
  if (cam0["T_cam_imu"]) {
    const auto values = file.numbers(cam0["T_cam_imu"], "T_cam_imu");
    rig.left.T_b_s = file.rigid(values, "T_cam_imu", unit).inverse();
  }
  const auto T = file.rigid(file.numbers(cam1["T_cn_cnm1"], "T_cn_cnm1"), "T_cn_cnm1", unit);
  rig.right.T_b_s = rig.left.T_b_s * T.inverse();
  return rig;
}

RawCamera own_camera(const CalibrationFile& file, const char* key) {
  const YAML::Node node = file.root()[key];
  if (!node.IsMap()) file.fail(std::string("'") + key + "' is no camera");
  RawCamera camera;
  camera.width = file.side(file.number(node, "width"), "width");
  camera.height = file.side(file.number(node, "height"), "height");
  camera.fx = file.number(node, "fx"), camera.fy = file.number(node, "fy");
  camera.cx = file.number(node, "cx"), camera.cy = file.number(node, "cy");
  if (node["distortion"]) camera.distortion = file.numbers(node["distortion"], "distortion");
  camera.lens = lens_of(word(node["model"]), camera.distortion, "model", file.name());
  drop_padding(camera.distortion, camera.lens);
  return camera;
}

StereoRig read_own(const CalibrationFile& file, double unit) {
  StereoRig rig{own_camera(file, "left"), own_camera(file, "right"), file.name()};
  const auto values = file.numbers(file.root()["T_left_right"], "T_left_right");
  rig.right.T_b_s = file.rigid(values, "T_left_right", unit);
  return rig;
}

/// The first of some names a key goes by, in any of the files.
struct Found {
  const CalibrationFile* file = nullptr;
  std::string key;
};
Found find_key(std::span<const CalibrationFile> files, std::initializer_list<const char*> names) {
  for (const CalibrationFile& file : files) {
    for (const char* name : names) {
      if (file.has(name)) return {&file, name};
    }
  }
  return {};
}

std::vector<double> opencv_matrix(std::span<const CalibrationFile> files,
                                  std::initializer_list<const char*> names, std::size_t count) {
  const Found found = find_key(files, names);
  if (found.file == nullptr) files[0].fail("no '" + std::string(*names.begin()) + "'");
  const YAML::Node node = found.file->root()[found.key];
  if (count > 0) {
    std::vector<double> values = found.file->numbers(node, found.key);
    if (values.size() != count) found.file->fail("'" + found.key + "' has the wrong size");
    return values;
  }
  return found.file->numbers(node, found.key);
}

/// Images sizes are in OpenCV's files under many names, or not at all.
void opencv_size(std::span<const CalibrationFile> files, StereoRig& rig) {
  const Found list = find_key(files, {"image_size", "imageSize", "image_Size", "size"});
  const Found width = find_key(files, {"image_width", "imageWidth", "width"});
  const Found height = find_key(files, {"image_height", "imageHeight", "height"});
  if (list.file != nullptr) {
    const YAML::Node node = list.file->root()[list.key];
    list.file->set_size(list.file->numbers(node, list.key), list.key, rig.left);
  } else if (width.file != nullptr && height.file != nullptr) {
    rig.left.width = width.file->side(width.file->number(width.file->root(), width.key), width.key);
    rig.left.height =
        height.file->side(height.file->number(height.file->root(), height.key), height.key);
  }
  rig.right.width = rig.left.width;
  rig.right.height = rig.left.height;
}

/// The name of the lens model; "" without.
std::string opencv_model(std::span<const CalibrationFile> files) {
  const Found model = find_key(files, {"distortion_model", "model"});
  if (model.file != nullptr) return word(model.file->root()[model.key]);
  const Found flag = find_key(files, {"fisheye_model"});
  if (flag.file == nullptr) return "";
  return flag.file->number(flag.file->root(), flag.key) != 0 ? "fisheye" : "radtan";
}

StereoRig read_opencv(std::span<const CalibrationFile> files, double unit) {
  StereoRig rig;
  rig.name = files[0].name();
  const auto K1 = opencv_matrix(files, {"M1", "K1", "cameraMatrix1", "camera_matrix_1"}, 9);
  const auto K2 = opencv_matrix(files, {"M2", "K2", "cameraMatrix2", "camera_matrix_2"}, 9);
  rig.left.distortion = opencv_matrix(files, {"D1", "distCoeffs1", "dist_coeffs_1"}, 0);
  rig.right.distortion = opencv_matrix(files, {"D2", "distCoeffs2", "dist_coeffs_2"}, 0);
  const auto R = opencv_matrix(files, {"R"}, 9);
  const auto T = opencv_matrix(files, {"T"}, 3);
  rig.left.fx = K1[0], rig.left.cx = K1[2], rig.left.fy = K1[4], rig.left.cy = K1[5];
  rig.right.fx = K2[0], rig.right.cx = K2[2], rig.right.fy = K2[4], rig.right.cy = K2[5];
  const std::string model = opencv_model(files);
  for (RawCamera* camera : {&rig.left, &rig.right}) {
    camera->lens = lens_of(model, camera->distortion, "distortion_model", rig.name);
    drop_padding(camera->distortion, camera->lens);
  }
  opencv_size(files, rig);
  const std::vector<double> rows{R[0], R[1], R[2], T[0], R[3], R[4], R[5], T[1],
                                 R[6], R[7], R[8], T[2], 0,    0,    0,    1};
  rig.right.T_b_s = files[0].rigid(rows, "R, T", unit).inverse();  // x_right = R x_left + T
  return rig;
}

std::string list(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + yaml_number(value);
  return text.empty() ? "[]" : text + "]";
}

/// How to adapt a calibration to images that are smaller or larger by one factor.
std::string resize_hint(const RawCamera& camera, int width, int height) {
  const double x = static_cast<double>(width) / camera.width;
  const double y = static_cast<double>(height) / camera.height;
  if (std::abs(x - y) > 0.01 * x) return "";
  return fmt::format(
      ". If the images were resized, multiply fx, fy, cx and cy by {:.4g} and state their size", x);
}

}  // namespace

StereoRig read_stereo_rig(std::span<const fs::path> paths, double unit) {
  if (paths.empty() || paths.size() > 2) throw InputError("one or two calibration files");
  if (!(unit > 0) || !std::isfinite(unit))
    throw InputError("the calibration's unit is not positive");
  std::vector<CalibrationFile> files;
  for (const fs::path& path : paths) files.emplace_back(path);
  StereoRig rig;
  if (files.size() == 2 && is_camera_info(files[0]) && is_camera_info(files[1])) {
    rig = rig_from_camera_info(read_camera_info(files[0]), read_camera_info(files[1]),
                               files[0].name() + ", " + files[1].name());
    rig.right.T_b_s.translation *= unit;
  } else if (find_key(files, {"M1", "K1", "cameraMatrix1", "camera_matrix_1"}).file != nullptr) {
    rig = read_opencv(files, unit);
  } else if (files.size() == 1 && files[0].has("cam0")) {
    rig = read_kalibr(files[0], unit);
  } else if (files.size() == 1 && files[0].has("left") && files[0].has("right")) {
    rig = read_own(files[0], unit);
  } else if (files.size() == 1 && is_orb_slam_settings(files[0])) {
    rig = read_orb_slam_settings(files[0], unit);
  } else if (files.size() == 1 && is_camera_info(files[0])) {
    files[0].fail("the camera_info of one camera; give the left and the right camera's file");
  } else {
    files[0].fail(
        "neither Kalibr's camchain (cam0, cam1), nor OpenCV's stereo calibration (M1, D1, "
        "M2, D2, R, T), nor left: and right: cameras, nor one of two camera_info files, nor "
        "settings of "
        "ORB-SLAM (Camera1.fx, Camera.bf)");
  }
  rig.unit_remedy = "--calibration-unit says how many metres a unit has (mm: 0.001)";
  return rig;
}

std::string to_yaml(const StereoRig& rig) {
  std::string text = "# Raw cameras in px; T_left_right: x_left = T x_right, m.\n";
  for (const auto& [key, c] : {std::pair("left", &rig.left), std::pair("right", &rig.right)}) {
    if (c->width == 0 || c->height == 0) {
      throw InputError(rig.name + ": does not say the size of the images");
    }
    const char* lens = c->lens == LensModel::kEquidistant ? "equidistant" : "radtan";
    text += std::string(key) + ": {width: " + std::to_string(c->width) +
            ", height: " + std::to_string(c->height) + ", fx: " + yaml_number(c->fx) +
            ", fy: " + yaml_number(c->fy) + ", cx: " + yaml_number(c->cx) +
            ", cy: " + yaml_number(c->cy) + ",\n  model: " + lens +
            ", distortion: " + list(c->distortion) + "}\n";
  }
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> T = Eigen::Matrix4d::Identity();
  T.topRows<3>() = (rig.left.T_b_s.inverse() * rig.right.T_b_s).matrix();
  return text + "T_left_right: " + list({T.data(), 16}) + "\n";
}

double StereoRig::baseline() const {
  return (left.T_b_s.inverse() * right.T_b_s).translation.norm();
}

std::optional<StereoCamera> StereoRig::rectified() const {
  const auto bent = [](const RawCamera& c) {
    return c.lens == LensModel::kEquidistant ||
           std::any_of(c.distortion.begin(), c.distortion.end(), [](double k) { return k != 0; });
  };
  if (bent(left) || bent(right)) return std::nullopt;
  const Rigid3 T_l_r = left.T_b_s.inverse() * right.T_b_s;
  const Eigen::Vector3d& t = T_l_r.translation;
  const bool parallel = rotation_angle(T_l_r) < 1e-9 && t.x() > 0 &&
                        kys::portable::hypot(t.y(), t.z()) < 1e-9 * t.x();
  const bool equal = left.fx == right.fx && left.fy == right.fy && left.cx == right.cx &&
                     left.cy == right.cy && left.width == right.width &&
                     left.height == right.height;
  if (!parallel || !equal) return std::nullopt;
  return StereoCamera{left.width, left.height, left.fx, left.fy, left.cx, left.cy, t.x()};
}

void StereoRig::set_image_size(int width, int height) {
  for (RawCamera* camera : {&left, &right}) {
    if (camera->width == 0 && camera->height == 0) {
      if (const std::string other = other_image_size(camera->cx, camera->cy, width, height);
          !other.empty()) {
        throw InputError(name + ": " + other +
                         "; if they were not, add the size to the calibration (image_width, "
                         "image_height)");
      }
      camera->width = width;
      camera->height = height;
    }
    if (is_other_order(camera->fx, camera->fy, camera->cx, camera->cy, width)) {
      throw InputError(fmt::format(
          "{}: intrinsics {:.6g}, {:.6g}, {:.6g}, {:.6g} are in the order fx, cx, fy, cy by their "
          "values; the order is fx, fy, cx, cy",
          name, camera->fx, camera->fy, camera->cx, camera->cy));
    }
    if (camera->width == width && camera->height == height) continue;
    throw InputError(fmt::format("{}: made for images of {}x{} px, these are {}x{}{}", name,
                                 camera->width, camera->height, width, height,
                                 resize_hint(*camera, width, height)));
  }
  check_baseline();
}

void StereoRig::check_baseline() const {
  require_baseline(baseline(), name, unit_remedy);
}

}  // namespace kys_slam
