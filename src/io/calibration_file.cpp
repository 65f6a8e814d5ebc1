// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration_file.h"

#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "io/yaml_file.h"

namespace kys_slam {

CalibrationFile::CalibrationFile(const std::filesystem::path& path) : path_(path) {
  // OpenCV's matrices are marked by a tag, which the reader of plain trees refuses.
  constexpr std::string_view kTag = "!!opencv-matrix";
  std::string text = read_text(path, 1 << 20);
  for (std::size_t at = 0; (at = text.find(kTag, at)) != std::string::npos;) {
    text.erase(at, kTag.size());
  }
  root_ = parse_yaml(std::move(text), path.string());
  if (!root_.IsMap()) fail("not a calibration in YAML");
}

void CalibrationFile::fail(const std::string& what) const {
  throw InputError(name() + ": " + what);
}

std::vector<double> CalibrationFile::numbers(const YAML::Node& node, const std::string& key) const {
  std::vector<double> values;
  append(node && node.IsMap() ? node["data"] : node, key, values);
  return values;
}

std::vector<double> CalibrationFile::numbers(const YAML::Node& parent, const std::string& key,
                                             std::size_t count) const {
  std::vector<double> values = numbers(parent[key], key);
  if (values.size() != count) {
    fail("'" + key + "' has " + std::to_string(values.size()) + " numbers instead of " +
         std::to_string(count));
  }
  return values;
}

double CalibrationFile::number(const YAML::Node& parent, const std::string& key) const {
  const YAML::Node node = parent[key];
  const auto value = node && node.IsScalar() ? parse_double(node.Scalar()) : std::nullopt;
  if (!value) fail("'" + key + "' is missing or not a finite number");
  return *value;
}

int CalibrationFile::side(double value, const std::string& key) const {
  if (!(value >= 2 && value <= kMaxImageSide && value == std::floor(value))) {
    fail("'" + key + "' is no image size");
  }
  return static_cast<int>(value);
}

void CalibrationFile::set_size(const std::vector<double>& size, const std::string& key,
                               RawCamera& camera) const {
  if (size.size() != 2) fail("'" + key + "' is no image size");
  camera.width = side(size[0], key);
  camera.height = side(size[1], key);
}

Rigid3 CalibrationFile::rigid(const std::vector<double>& values, const std::string& key,
                              double unit) const {
  if (values.size() != 16) fail("'" + key + "' is not a 4x4 matrix");
  if (values[12] != 0 || values[13] != 0 || values[14] != 0 || values[15] != 1) {
    fail("'" + key + "' is not a rigid transformation: the last row of '" + key +
         "' is not 0 0 0 1");
  }
  auto T = rigid_from_row_major(values.data());
  if (!T) fail("'" + key + "' is not a rigid transformation");
  T->translation *= unit;
  return *T;
}

void CalibrationFile::read_pinhole(const YAML::Node& node, const std::string& prefix,
                                   RawCamera& camera) const {
  if (const std::string model = word(node["camera_model"]); model != "pinhole") {
    fail(prefix + "camera_model '" + model +
         "' is not supported: calibrate as pinhole-radtan or pinhole-equi");
  }
  const std::vector<double> k = numbers(node, "intrinsics", 4);
  camera.fx = k[0], camera.fy = k[1], camera.cx = k[2], camera.cy = k[3];
  if (!(camera.fx > 0 && camera.fy > 0)) fail("'intrinsics': focal length is not positive");
  set_size(numbers(node, "resolution", 2), "resolution", camera);
  const std::string model = word(node["distortion_model"]);
  const char* key = node["distortion_coeffs"] ? "distortion_coeffs" : "distortion_coefficients";
  if (model != "none" || node[key]) camera.distortion = numbers(node[key], key);
  camera.lens = lens_of(model, camera.distortion, "distortion_model", name());
  drop_padding(camera.distortion, camera.lens);
  const std::size_t count = camera.distortion.size();
  if (camera.lens == LensModel::kRadialTangential && count != 0 && count != 4 && count != 5 &&
      count != 8) {
    fail(std::string("'") + key + "' has " + std::to_string(count) +
         " numbers instead of 4, 5 or 8");
  }
}

void CalibrationFile::append(const YAML::Node& node, const std::string& key,
                             std::vector<double>& values) const {
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

LensModel lens_of(const std::string& model, const std::vector<double>& distortion,
                  const std::string& key, const std::string& name) {
  const bool bent =
      std::any_of(distortion.begin(), distortion.end(), [](double k) { return k != 0; });
  if (model.empty() && distortion.size() == 4 && bent) {
    throw InputError(
        name +
        ": 4 distortion coefficients are k1 k2 p1 p2 of a radial-tangential lens, or k1 "
        "k2 k3 k4 of a fisheye lens; add '" +
        key + ": radtan' or '" + key + ": fisheye'");
  }
  std::string plain;
  for (const char c : model) {
    plain += c == '-' ? '_' : c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c;
  }
  for (const char* known : {"radtan", "radial_tangential", "plumb_bob", "rational_polynomial",
                            "brown_conrady", "none", ""}) {
    if (plain == known) return LensModel::kRadialTangential;
  }
  for (const char* known : {"equidistant", "equi", "fisheye", "kannala_brandt"}) {
    if (plain == known) return LensModel::kEquidistant;
  }
  throw InputError(name + ": distortion model '" + model + "' is not known: radtan or equidistant");
}

void drop_padding(std::vector<double>& distortion, LensModel lens) {
  const std::size_t most = lens == LensModel::kEquidistant ? 4 : 8;
  while (distortion.size() > most && distortion.back() == 0) distortion.pop_back();
  if (lens == LensModel::kEquidistant) return;
  if (distortion.size() > 5 && distortion.size() < 8) distortion.resize(8);
}

std::string word(const YAML::Node& node) {
  return node && node.IsScalar() ? node.Scalar() : std::string();
}

}  // namespace kys_slam
