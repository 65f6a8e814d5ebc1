// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>

#include "node_logic.h"

namespace kys_slam::ros {

/// One system with its camera, from a start to a reset.
struct NodeLogic::Run {
  Run(PairCalibration calibration_in, const NodeOptions& options, const Settings& settings)
      : calibration(std::move(calibration_in)),
        frames(options.T_base_camera() * calibration.T_raw_c),
        system(calibration.camera, settings, options.schedule) {}

  /// 8-bit grey and rectified.
  [[nodiscard]] GrayImage prepared(Side side, ImageView view) const {
    view.bits = bits;
    return rectified(side, to_gray(view));
  }
  [[nodiscard]] GrayImage rectified(Side side, GrayImage image) const {
    if (!calibration.rectifier) return image;
    return side == Side::kLeft ? calibration.rectifier->rectify_left(image)
                               : calibration.rectifier->rectify_right(image);
  }

  PairCalibration calibration;
  int width = 0, height = 0;  // px, of the image messages
  int bits = 0;               // of 16-bit images, 0: not known
  Rep105Frames frames;
  StereoMasks masks;
  bool has_masks = false;  // `masks` are those of the node
  std::int64_t fed = 0;    // frames
  System system;
};

}  // namespace kys_slam::ros
