// SPDX-License-Identifier: BSD-3-Clause
#include "calibration.h"

namespace kys_slam::ros {

namespace {

constexpr auto kName = "camera_info";

bool equal(const CameraInfo& a, const CameraInfo& b) {
  return a.width == b.width && a.height == b.height && a.distortion_model == b.distortion_model &&
         a.D == b.D && a.K == b.K && a.R == b.R && a.P == b.P && a.binning_x == b.binning_x &&
         a.binning_y == b.binning_y && a.roi == b.roi;
}

/// The camera that P describes, as a pinhole camera of its own.
CameraInfo as_rectified(CameraInfo info) {
  info.distortion_model.clear();
  info.D.clear();
  info.K = {info.P[0], info.P[1], info.P[2], info.P[4], info.P[5],
            info.P[6], info.P[8], info.P[9], info.P[10]};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  return info;
}

}  // namespace

CameraInfos::Arrival CameraInfos::add(Side side, const CameraInfo& info) {
  if (info.K[0] == 0 && info.P[0] == 0) return Arrival::kEmpty;
  const auto i = static_cast<std::size_t>(side);
  latest_[i] = info;
  if (infos_[i]) return equal(*infos_[i], info) ? Arrival::kSame : Arrival::kChanged;
  infos_[i] = info;
  return Arrival::kTaken;
}

void CameraInfos::take_latest() {
  infos_ = latest_;
}

std::string CameraInfos::missing() const {
  if (infos_[0]) return infos_[1] ? "" : "right";
  return infos_[1] ? "left" : "left and right";
}

PairCalibration calibrate(const CameraInfos& infos, bool rectified, int width, int height) {
  CameraInfo left = *infos.of(Side::kLeft);
  CameraInfo right = *infos.of(Side::kRight);
  if (rectified) {
    left = as_rectified(left);
    right = as_rectified(right);
  }
  StereoRig rig = rig_from_camera_info(left, right, kName, width, height);
  rig.set_image_size(width, height);
  PairCalibration calibration;
  if (const auto camera = rig.rectified()) {
    calibration.camera = *camera;
    return calibration;
  }
  calibration.rectifier.emplace(rig.left, rig.right, rig.name);
  calibration.camera = calibration.rectifier->camera();
  calibration.T_raw_c = rig.left.T_b_s.inverse() * calibration.rectifier->T_b_c();
  return calibration;
}

}  // namespace kys_slam::ros
