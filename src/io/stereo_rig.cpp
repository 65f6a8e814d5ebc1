// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/stereo_rig.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <string_view>
#include <utility>

#include "io/yaml_file.h"

namespace kys_slam {

namespace fs = std::filesystem;

namespace {

/// A YAML file whose numbers are asked for by key.
class CalibrationFile {
 public:
  explicit CalibrationFile(const fs::path& path) : path_(path) {
    // OpenCV's matrices are marked by a tag, which the reader of plain trees refuses.
    constexpr std::string_view kTag = "!!opencv-matrix";
    std::string text = read_text(path, 1 << 20);
    for (std::size_t at = 0; (at = text.find(kTag, at)) != std::string::npos;) {
      text.erase(at, kTag.size());
    }
    root_ = parse_yaml(std::move(text), path.string());
    if (!root_.IsMap()) throw InputError(path.string() + ": not a calibration in YAML");
  }

  [[nodiscard]] const fs::path& path() const { return path_; }
  [[nodiscard]] std::string name() const { return path_.string(); }
  [[nodiscard]] const YAML::Node& root() const { return root_; }
  [[nodiscard]] bool has(const char* key) const { return static_cast<bool>(root_[key]); }

  [[noreturn]] void fail(const std::string& what) const { throw InputError(name() + ": " + what); }

  /// Numbers of a list, of a list of lists, or of a matrix with `data`.
  [[nodiscard]] std::vector<double> numbers(const YAML::Node& node, const std::string& key) const {
    std::vector<double> values;
    append(node && node.IsMap() ? node["data"] : node, key, values);
    return values;
  }
  [[nodiscard]] std::vector<double> numbers(const YAML::Node& parent, const std::string& key,
                                            std::size_t count) const {
    std::vector<double> values = numbers(parent[key], key);
    if (values.size() != count) {
      fail("'" + key + "' has " + std::to_string(values.size()) + " numbers instead of " +
           std::to_string(count));
    }
    return values;
  }
  [[nodiscard]] double number(const YAML::Node& parent, const std::string& key) const {
    const YAML::Node node = parent[key];
    const auto value = node && node.IsScalar() ? parse_double(node.Scalar()) : std::nullopt;
    if (!value) fail("'" + key + "' is missing or not a finite number");
    return *value;
  }
  [[nodiscard]] int side(double value, const std::string& key) const {
    if (!(value >= 2 && value <= kMaxImageSide && value == std::floor(value))) {
      fail("'" + key + "' is no image size");
    }
    return static_cast<int>(value);
  }
  [[nodiscard]] Rigid3 rigid(const std::vector<double>& values, const std::string& key,
                             double unit) const {
    if (values.size() != 16) fail("'" + key + "' is not a 4x4 matrix");
    auto T = rigid_from_row_major(values.data());
    if (!T) fail("'" + key + "' is not a rigid transformation");
    T->translation *= unit;
    return *T;
  }

 private:
  void append(const YAML::Node& node, const std::string& key, std::vector<double>& values) const {
    if (!node || !node.IsSequence()) fail("'" + key + "' is missing or not a list of numbers");
    for (const YAML::Node& item : node) {
      if (item.IsSequence()) {
        append(item, key, values);
        continue;
      }
      const auto value = item.IsScalar() ? parse_double(item.Scalar()) : std::nullopt;
      if (!value) fail("'" + key + "' holds something that is not a finite number");
      values.push_back(*value);
      if (values.size() > 64) fail("'" + key + "' is too long");
    }
  }

  fs::path path_;
  YAML::Node root_;
};

LensModel lens_of(const CalibrationFile& file, const std::string& name) {
  for (const char* known :
       {"radtan", "radial-tangential", "plumb_bob", "rational_polynomial", "none", ""}) {
    if (name == known) return LensModel::kRadialTangential;
  }
  for (const char* known : {"equidistant", "fisheye", "kannala_brandt"}) {
    if (name == known) return LensModel::kEquidistant;
  }
  file.fail("distortion model '" + name + "' is not known: radtan or equidistant");
}

std::string word(const YAML::Node& node) {
  return node && node.IsScalar() ? node.Scalar() : std::string();
}

/// cam0, cam1 of a Kalibr camchain.
RawCamera kalibr_camera(const CalibrationFile& file, const char* key) {
  const YAML::Node node = file.root()[key];
  if (!node.IsMap()) file.fail(std::string("'") + key + "' is no camera");
  if (word(node["camera_model"]) != "pinhole") {
    file.fail(std::string(key) + ": camera_model '" + word(node["camera_model"]) +
              "' is not supported: calibrate as pinhole-radtan or pinhole-equi");
  }
  RawCamera camera;
  const std::vector<double> k = file.numbers(node, "intrinsics", 4);
  const std::vector<double> size = file.numbers(node, "resolution", 2);
  camera.width = file.side(size[0], "resolution");
  camera.height = file.side(size[1], "resolution");
  camera.fx = k[0], camera.fy = k[1], camera.cx = k[2], camera.cy = k[3];
  camera.distortion = file.numbers(node["distortion_coeffs"], "distortion_coeffs");
  camera.lens = lens_of(file, word(node["distortion_model"]));
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
  camera.lens = lens_of(file, word(node["model"]));
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
    const auto size = list.file->numbers(list.file->root()[list.key], list.key);
    if (size.size() != 2) list.file->fail("'" + list.key + "' is no image size");
    rig.left.width = list.file->side(size[0], list.key);
    rig.left.height = list.file->side(size[1], list.key);
  } else if (width.file != nullptr && height.file != nullptr) {
    rig.left.width = width.file->side(width.file->number(width.file->root(), width.key), width.key);
    rig.left.height =
        height.file->side(height.file->number(height.file->root(), height.key), height.key);
  }
  rig.right.width = rig.left.width;
  rig.right.height = rig.left.height;
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
  for (RawCamera* camera : {&rig.left, &rig.right}) {
    // calibrateCamera pads with zeros up to 14 coefficients.
    auto& d = camera->distortion;
    while (d.size() > 8 && d.back() == 0) d.pop_back();
    if (d.size() > 5 && d.size() < 8) d.resize(8);
  }
  const Found model = find_key(files, {"distortion_model", "model"});
  if (model.file != nullptr) {
    rig.left.lens = rig.right.lens = lens_of(*model.file, word(model.file->root()[model.key]));
  }
  opencv_size(files, rig);
  const std::vector<double> rows{R[0], R[1], R[2], T[0], R[3], R[4], R[5], T[1],
                                 R[6], R[7], R[8], T[2], 0,    0,    0,    1};
  rig.right.T_b_s = files[0].rigid(rows, "R, T", unit).inverse();  // x_right = R x_left + T
  return rig;
}

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
  return info;
}

bool is_camera_info(const CalibrationFile& file) {
  return file.has("camera_matrix") || (file.has("K") && file.has("P")) ||
         (file.has("k") && file.has("p"));
}

RawCamera raw_camera(const CameraInfo& info, const std::string& name) {
  RawCamera camera;
  camera.width = info.width;
  camera.height = info.height;
  camera.fx = info.K[0], camera.cx = info.K[2], camera.fy = info.K[4], camera.cy = info.K[5];
  camera.distortion = info.D;
  if (info.distortion_model == "equidistant" || info.distortion_model == "fisheye") {
    camera.lens = LensModel::kEquidistant;
  } else if (!info.distortion_model.empty() && info.distortion_model != "plumb_bob" &&
             info.distortion_model != "rational_polynomial") {
    throw InputError(name + ": distortion model '" + info.distortion_model + "' is not known");
  }
  return camera;
}

/// As few digits as give the same number back.
std::string digits(double value) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}

std::string list(std::span<const double> values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "[" : ", ") + digits(value);
  return text.empty() ? "[]" : text + "]";
}

}  // namespace

StereoRig rig_from_camera_info(const CameraInfo& left, const CameraInfo& right,
                               const std::string& name) {
  StereoRig rig{raw_camera(left, name), raw_camera(right, name), name};
  if (!(right.P[0] > 0) || !std::isfinite(right.P[3])) {
    throw InputError(name + ": the right camera's P is not that of a rectified camera");
  }
  const double shift = right.P[3] / right.P[0] - (left.P[0] > 0 ? left.P[3] / left.P[0] : 0);
  if (!(shift < 0)) {
    throw InputError(name + ": the right camera's P[3] is " + std::to_string(right.P[3]) +
                     ", not negative: no stereo calibration, or left and right are swapped");
  }
  // x_rectified = R x_raw in both; the right rectified camera sees x - baseline.
  const auto rotation = [&](const std::array<double, 9>& R) {
    const std::vector<double> rows{R[0], R[1], R[2], 0, R[3], R[4], R[5], 0, R[6], R[7], R[8], 0};
    const auto T = rigid_from_row_major(rows.data());
    if (!T) throw InputError(name + ": R is not a rotation");
    return *T;
  };
  const Rigid3 T_shift(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-shift, 0, 0));
  rig.right.T_b_s = rotation(left.R).inverse() * T_shift * rotation(right.R);
  return rig;
}

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
  } else if (files.size() == 1 && is_camera_info(files[0])) {
    files[0].fail("the camera_info of one camera; give the left and the right camera's file");
  } else {
    files[0].fail(
        "neither Kalibr's camchain (cam0, cam1), nor OpenCV's stereo calibration (M1, D1, "
        "M2, D2, R, T), nor left: and right: cameras, nor one of two camera_info files");
  }
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
            ", height: " + std::to_string(c->height) + ", fx: " + digits(c->fx) +
            ", fy: " + digits(c->fy) + ", cx: " + digits(c->cx) + ", cy: " + digits(c->cy) +
            ",\n  model: " + lens + ", distortion: " + list(c->distortion) + "}\n";
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
  const bool parallel =
      rotation_angle(T_l_r) < 1e-9 && t.x() > 0 && std::hypot(t.y(), t.z()) < 1e-9 * t.x();
  const bool equal = left.fx == right.fx && left.fy == right.fy && left.cx == right.cx &&
                     left.cy == right.cy && left.width == right.width &&
                     left.height == right.height;
  if (!parallel || !equal) return std::nullopt;
  return StereoCamera{left.width, left.height, left.fx, left.fy, left.cx, left.cy, t.x()};
}

void StereoRig::set_image_size(int width, int height) {
  for (RawCamera* camera : {&left, &right}) {
    if (camera->width == 0) camera->width = width;
    if (camera->height == 0) camera->height = height;
    if (camera->width != width || camera->height != height) {
      throw InputError(name + ": made for images of " + std::to_string(camera->width) + "x" +
                       std::to_string(camera->height) + " px, these are " + std::to_string(width) +
                       "x" + std::to_string(height));
    }
  }
  if (const double b = baseline(); !(b >= 0.005 && b <= 5)) {
    throw InputError(name + ": the baseline is " + std::to_string(b) +
                     " m; is the calibration in other units? (mm: --calibration-unit 0.001)");
  }
}

}  // namespace kys_slam
