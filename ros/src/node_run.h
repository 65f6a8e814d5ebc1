// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>

#include "node_logic.h"

namespace kys_slam::ros {

/// One system with its camera, from a start to a reset.
struct NodeLogic::Run {
  /// \param T_base_camera of the camera of the image messages
  Run(const ImageKind& images_in, PairCalibration calibration_in, const Rigid3& T_base_camera,
      Schedule schedule, const Settings& settings)
      : images(images_in),
        calibration(std::move(calibration_in)),
        frames(T_base_camera * calibration.T_raw_c),
        system(calibration.camera, settings, schedule) {}

  /// 8-bit grey and rectified.
  [[nodiscard]] GrayImage prepared(Side side, ImageView view) const {
    view.bits = images.bits;
    return rectified(side, to_gray(view));
  }
  [[nodiscard]] GrayImage rectified(Side side, GrayImage image) const {
    if (!calibration.rectifier) return image;
    return side == Side::kLeft ? calibration.rectifier->rectify_left(image)
                               : calibration.rectifier->rectify_right(image);
  }

  ImageKind images;
  PairCalibration calibration;
  Rep105Frames frames;
  StereoMasks masks;
  bool has_masks = false;  // `masks` are those of the node
  std::int64_t fed = 0;    // frames
  System system;
};

}  // namespace kys_slam::ros
