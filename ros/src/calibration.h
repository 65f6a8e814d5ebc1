// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/stereo_rig.h>

#include <array>
#include <optional>
#include <string>

#include "messages.h"

namespace kys_slam::ros {

/// The camera_info of both cameras. The first one of a camera that is not all zeros counts.
class CameraInfos {
 public:
  enum class Arrival : std::uint8_t { kTaken, kSame, kEmpty, kChanged };
  /// kEmpty: all zeros, as drivers without a calibration send it. kChanged: it differs from the
  /// one that counts and is refused.
  Arrival add(Side side, const CameraInfo& info);
  [[nodiscard]] const std::optional<CameraInfo>& of(Side side) const {
    return infos_[static_cast<std::size_t>(side)];
  }
  /// The last one of each camera counts from now on, also one that was refused.
  void take_latest();
  [[nodiscard]] bool complete() const { return infos_[0] && infos_[1]; }
  /// "left", "right", "left and right": whose is missing.
  [[nodiscard]] std::string missing() const;

 private:
  std::array<std::optional<CameraInfo>, 2> infos_;
  std::array<std::optional<CameraInfo>, 2> latest_;
};

/// The camera of the frames that are tracked, and how images become these.
struct PairCalibration {
  StereoCamera camera;
  std::optional<StereoRectifier> rectifier;  ///< nothing: images are rectified
  Rigid3 T_raw_c;                            ///< tracked left camera to that of the image messages
};
/// \param rectified images are rectified by R and P, whatever D says: image_rect of image_proc has
///        the camera_info of its raw image
/// \param width, height of the images, px \throws InputError when the calibration is no stereo
///        calibration of such images
PairCalibration calibrate(const CameraInfos& infos, bool rectified, int width, int height);

}  // namespace kys_slam::ros
