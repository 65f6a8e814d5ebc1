// SPDX-License-Identifier: BSD-3-Clause
#include "io/orb_slam_settings.h"

#include <kys_slam/rig_file.h>

#include <algorithm>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

/// One camera, whose keys begin with a prefix: "Camera1".
class CameraKeys {
 public:
  CameraKeys(const CalibrationFile& file, std::string prefix)
      : file_(file), prefix_(std::move(prefix) + ".") {}

  [[nodiscard]] bool has(const char* key) const { return file_.has((prefix_ + key).c_str()); }
  [[nodiscard]] double number(const char* key) const {
    return file_.number(file_.root(), prefix_ + key);
  }
  [[nodiscard]] int side(const char* key) const { return file_.side(number(key), prefix_ + key); }
  [[nodiscard]] std::vector<double> numbers(const char* key) const {
    return file_.numbers(file_.root()[prefix_ + key], prefix_ + key);
  }
  /// A matrix of `count` numbers.
  [[nodiscard]] std::vector<double> matrix(const char* key, std::size_t count) const {
    return file_.numbers(file_.root(), prefix_ + key, count);
  }
  /// The coefficients that there are.
  [[nodiscard]] std::vector<double> coefficients(std::initializer_list<const char*> keys) const {
    std::vector<double> values;
    for (const char* key : keys) {
      if (has(key)) values.push_back(number(key));
    }
    return values;
  }
  void read_intrinsics(RawCamera& camera) const {
    camera.fx = number("fx"), camera.fy = number("fy");
    camera.cx = number("cx"), camera.cy = number("cy");
  }

 private:
  const CalibrationFile& file_;
  std::string prefix_;
};

void read_size(const CalibrationFile& file, RawCamera& camera) {
  if (!file.has("Camera.width") || !file.has("Camera.height")) return;
  camera.width = file.side(file.number(file.root(), "Camera.width"), "Camera.width");
  camera.height = file.side(file.number(file.root(), "Camera.height"), "Camera.height");
}

/// The model of `Camera.type` with its coefficients.
void read_lens(const CalibrationFile& file, const std::string& type, const CameraKeys& keys,
               RawCamera& camera) {
  const bool fisheye = type == "KannalaBrandt8";
  camera.distortion = fisheye ? keys.coefficients({"k1", "k2", "k3", "k4"})
                              : keys.coefficients({"k1", "k2", "p1", "p2", "k3"});
  if (fisheye && camera.distortion.size() != 4) {
    file.fail("Camera.type KannalaBrandt8 needs k1, k2, k3 and k4 of both cameras");
  }
  camera.lens =
      lens_of(fisheye ? "equidistant" : "radtan", camera.distortion, "Camera.type", file.name());
  drop_padding(camera.distortion, camera.lens);
}

StereoRig rectified_pair(const CalibrationFile& file, const RawCamera& c, double baseline) {
  return rig_of({c.width, c.height, c.fx, c.fy, c.cx, c.cy, baseline}, file.name());
}

/// Of ORB-SLAM3.
StereoRig read_two_cameras(const CalibrationFile& file, double unit) {
  const std::string type = word(file.root()["Camera.type"]);
  const CameraKeys one(file, "Camera1"), two(file, "Camera2");
  StereoRig rig;
  rig.name = file.name();
  one.read_intrinsics(rig.left);
  read_size(file, rig.left);
  if (type == "Rectified") {
    return rectified_pair(file, rig.left, file.number(file.root(), "Stereo.b") * unit);
  }
  if (type != "PinHole" && type != "KannalaBrandt8") {
    file.fail("Camera.type is '" + type + "', not PinHole, KannalaBrandt8 or Rectified");
  }
  two.read_intrinsics(rig.right);
  read_size(file, rig.right);
  read_lens(file, type, one, rig.left);
  read_lens(file, type, two, rig.right);
  // p_1 = T_c1_c2 p_2
  rig.right.T_b_s = file.rigid(file.numbers(file.root()["Stereo.T_c1_c2"], "Stereo.T_c1_c2"),
                               "Stereo.T_c1_c2", unit);
  return rig;
}

CameraInfo info_of(const CameraKeys& keys) {
  CameraInfo info;
  info.distortion_model = "plumb_bob";
  info.width = keys.side("width");
  info.height = keys.side("height");
  info.D = keys.numbers("D");
  std::ranges::copy(keys.matrix("K", info.K.size()), info.K.begin());
  std::ranges::copy(keys.matrix("R", info.R.size()), info.R.begin());
  std::ranges::copy(keys.matrix("P", info.P.size()), info.P.begin());
  return info;
}

/// Of ORB-SLAM2.
StereoRig read_one_camera(const CalibrationFile& file, double unit) {
  const CameraKeys left(file, "LEFT"), right(file, "RIGHT");
  if (left.has("K")) {
    CameraInfo info = info_of(right);
    info.P[3] *= unit;
    return rig_from_camera_info(info_of(left), info, file.name());
  }
  const CameraKeys keys(file, "Camera");
  RawCamera camera;
  keys.read_intrinsics(camera);
  read_size(file, camera);
  for (const double k : keys.coefficients({"k1", "k2", "p1", "p2", "k3"})) {
    if (k != 0) {
      file.fail(
          "a lens (Camera.k1, ...) of a pair that is rectified (Camera.bf): which one is right? "
          "Raw cameras need LEFT.K and the like, or the keys of ORB-SLAM3");
    }
  }
  if (!keys.has("bf")) file.fail("no Camera.bf: settings of a single camera");
  return rectified_pair(file, camera, keys.number("bf") / camera.fx * unit);
}

}  // namespace

bool is_orb_slam_settings(const CalibrationFile& file) {
  return file.has("Camera1.fx") || file.has("Camera.fx");
}

StereoRig read_orb_slam_settings(const CalibrationFile& file, double unit) {
  return file.has("Camera1.fx") ? read_two_cameras(file, unit) : read_one_camera(file, unit);
}

}  // namespace kys_slam
