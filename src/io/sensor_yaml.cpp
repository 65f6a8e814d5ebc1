// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/sequence.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/parse_number.h>

#include "io/yaml_file.h"

namespace kys_slam {
namespace {

class SensorFile {
 public:
  explicit SensorFile(const std::filesystem::path& path) : path_(path) {
    root_ = load_yaml(path);
    if (!root_.IsMap()) fail("not a calibration in YAML");
  }

  [[nodiscard]] YAML::Node get(const std::string& key) const {
    const YAML::Node node = root_[key];
    if (!node) fail("no '" + key + "'");
    return node;
  }

  [[nodiscard]] std::vector<double> numbers(const YAML::Node& node, const std::string& key) const {
    if (!node || !node.IsSequence()) fail("'" + key + "' is not a list of numbers");
    std::vector<double> values;
    for (const YAML::Node& item : node) {
      const auto value = item.IsScalar() ? parse_double(item.Scalar()) : std::nullopt;
      if (!value) fail("'" + key + "' holds something that is not a finite number");
      values.push_back(*value);
    }
    return values;
  }

  [[nodiscard]] std::vector<double> numbers(const std::string& key, std::size_t count) const {
    std::vector<double> values = numbers(get(key), key);
    if (values.size() != count) {
      fail("'" + key + "' has " + std::to_string(values.size()) + " numbers instead of " +
           std::to_string(count));
    }
    return values;
  }

  [[nodiscard]] std::string word(const std::string& key) const {
    const YAML::Node node = get(key);
    return node.IsScalar() ? node.Scalar() : std::string();
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw InputError(path_.string() + ": " + what);
  }

 private:
  std::filesystem::path path_;
  YAML::Node root_;
};

RawCamera read_camera(const std::filesystem::path& path) {
  const SensorFile file(path);
  if (file.word("camera_model") != "pinhole") file.fail("camera_model is not 'pinhole'");
  if (file.word("distortion_model") != "radial-tangential") {
    file.fail("distortion_model is not 'radial-tangential'");
  }
  RawCamera camera;
  const std::vector<double> resolution = file.numbers("resolution", 2);
  for (const double side : resolution) {
    if (!(side >= 1 && side <= kMaxImageSide && side == std::floor(side))) {
      file.fail("'resolution' is out of range");
    }
  }
  camera.width = static_cast<int>(resolution[0]);
  camera.height = static_cast<int>(resolution[1]);
  const std::vector<double> k = file.numbers("intrinsics", 4);
  camera.fx = k[0];
  camera.fy = k[1];
  camera.cx = k[2];
  camera.cy = k[3];
  if (!(camera.fx > 0 && camera.fy > 0)) file.fail("'intrinsics': focal length is not positive");
  camera.distortion = file.numbers(file.get("distortion_coefficients"), "distortion_coefficients");
  if (camera.distortion.size() != 4 && camera.distortion.size() != 5) {
    file.fail("'distortion_coefficients' has " + std::to_string(camera.distortion.size()) +
              " numbers instead of 4 or 5");
  }
  const YAML::Node T_BS = file.get("T_BS");
  if (!T_BS.IsMap()) file.fail("'T_BS' has no 'data'");
  const std::vector<double> T = file.numbers(T_BS["data"], "T_BS.data");
  if (T.size() != 16) file.fail("'T_BS' is not a 4x4 matrix");
  if (T[12] != 0 || T[13] != 0 || T[14] != 0 || T[15] != 1) {
    file.fail("the last row of 'T_BS' is not 0 0 0 1");
  }
  const auto T_b_s = rigid_from_row_major(T.data());
  if (!T_b_s) file.fail("'T_BS' is not a rigid transformation");
  camera.T_b_s = *T_b_s;
  return camera;
}

}  // namespace

RawCamera read_sensor_yaml(const std::filesystem::path& path) {
  try {
    return read_camera(path);
  } catch (const YAML::Exception& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

}  // namespace kys_slam
