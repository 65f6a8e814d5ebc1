// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/features.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace kys_slam {

/// Detects faults of one camera of the pair: a dead or covered camera, an incomplete image, a
/// repeated image, while the other camera works. Uses keypoints only, which takes little time.
class CameraFaults {
 public:
  /// \param left, right  features of the next frame, before any is dropped
  /// \param width, height  of the images, px
  /// \returns one phrase, or "" when nothing is wrong
  std::string check(const FeatureSet& left, const FeatureSet& right, int width, int height);
  /// Whether the left image of the last check() repeats that of the frame before.
  [[nodiscard]] bool left_repeated() const { return left_repeated_; }

 private:
  /// Features of an image, to recognise a repetition.
  struct Trace {
    std::size_t features = 0;
    std::vector<kys::Descriptor> some;
    bool operator==(const Trace&) const = default;
  };
  [[nodiscard]] static Trace trace(const FeatureSet& features);
  std::array<Trace, 2> last_;
  bool left_repeated_ = false;
};

}  // namespace kys_slam
