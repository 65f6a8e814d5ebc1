// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/features.h>
#include <kys_slam/image.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// Input of the SLAM core for one time stamp: a rectified grey stereo pair, or the features of both
/// images from a simulation or another extractor.
struct StereoFrame {
  std::int64_t index = 0;  ///< position in the sequence, from 0
  std::string name;        ///< stem of the left image's file name ("000123"), or ""
  double timestamp = 0;    ///< s
  GrayImage left;          ///< rectified, (height, width); empty when features are given
  GrayImage right;
  /// Set together with right_features. At most 65535 per image, octaves below `orb.levels`, at most
  /// 16 px outside the image, orientations in 0..2 pi; other features are refused.
  std::optional<FeatureSet> left_features;
  std::optional<FeatureSet> right_features;
  bool has_priors = false;              ///< the frame carries priors
  std::vector<kys::Prior> left_priors;  ///< if has_priors: one per feature
  std::vector<kys::Prior> right_priors;
};

/// A stream of stereo frames: images of a sequence folder, a feature-level simulation, a camera.
/// Read in order by one thread.
class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  [[nodiscard]] virtual const StereoCamera& camera() const = 0;
  /// Number of frames, when known in advance.
  [[nodiscard]] virtual std::optional<std::int64_t> size() const = 0;
  /// The next frame, or nothing at the end.
  /// \throws InputError naming the file when the frame cannot be read.
  virtual std::optional<StereoFrame> next() = 0;
};

/// One pose of a trajectory: left camera to world.
struct TimedPose {
  double timestamp = 0;  ///< s
  Rigid3 T_w_c;
};

}  // namespace kys_slam
