// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// An oriented FAST corner. Coordinates are pixels of the rectified full-size image (level 0) for
/// every octave.
struct Keypoint {
  float x = 0;              ///< px, level 0
  float y = 0;              ///< px, level 0
  float angle = 0;          ///< rad in [0, 2 pi), intensity-centroid orientation
  float response = 0;       ///< FAST score: largest threshold at which it is a corner
  std::uint8_t octave = 0;  ///< pyramid level

  friend bool operator==(const Keypoint&, const Keypoint&) = default;
};

/// Keypoints of one image and their descriptors, index by index.
struct FeatureSet {
  std::vector<Keypoint> keypoints;
  std::vector<kys::Descriptor> descriptors;

  [[nodiscard]] std::size_t size() const { return keypoints.size(); }
  void clear() {
    keypoints.clear();
    descriptors.clear();
  }
};

}  // namespace kys_slam
