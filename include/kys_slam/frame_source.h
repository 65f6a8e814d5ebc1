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

/// What the SLAM core is fed, once per time stamp: either a rectified grey stereo pair, or the
/// features of both images as a simulation (or another extractor) made them.
struct StereoFrame {
  std::int64_t index = 0;  ///< position in the sequence, from 0; priors are found by it
  std::string name;        ///< stem of the left image's file name ("000123"), or ""
  double timestamp = 0;    ///< s
  GrayImage left;          ///< rectified; empty when features are given
  GrayImage right;
  std::optional<FeatureSet> left_features;  ///< set together with right_features
  std::optional<FeatureSet> right_features;
  bool has_priors = false;              ///< the features come with priors of their own
  std::vector<kys::Prior> left_priors;  ///< then: one per feature
  std::vector<kys::Prior> right_priors;
};

/// A stream of stereo frames: images of a sequence folder, a feature-level simulation, a caller's
/// own camera. One reader, in order.
class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  [[nodiscard]] virtual const StereoCamera& camera() const = 0;
  /// Number of frames, when it is known beforehand.
  [[nodiscard]] virtual std::optional<std::int64_t> size() const = 0;
  /// The next frame, or nothing at the end.
  /// \throws InputError naming the file when the frame cannot be read.
  virtual std::optional<StereoFrame> next() = 0;
};

/// One pose of a ground-truth trajectory, in the left camera's frame.
struct TimedPose {
  double timestamp = 0;  ///< s
  Rigid3 T_w_c;
};

}  // namespace kys_slam
