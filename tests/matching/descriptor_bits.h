// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/features.h>

#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam::testing {

/// The descriptor whose bits from `first` on, `count` of them, are set: from the zero descriptor it
/// is `count` away.
inline kys::Descriptor bits(int count, int first = 0) {
  kys::Descriptor d;
  for (int i = first; i < first + count; ++i) {
    d.words[static_cast<std::size_t>(i / 64)] |= std::uint64_t{1} << (i % 64);
  }
  return d;
}

/// One feature of a hand-made frame. A right column that is not a number: no stereo match.
struct HandMade {
  float x = 0;
  float y = 0;
  int octave = 0;
  kys::Descriptor descriptor;
  float u_right = std::numeric_limits<float>::quiet_NaN();
  float angle = 0;
};

inline FrameFeatures frame_of(const StereoCamera& camera, const std::vector<HandMade>& features) {
  FeatureSet set;
  std::vector<float> u_right;
  for (const HandMade& f : features) {
    set.keypoints.push_back({f.x, f.y, f.angle, 20, static_cast<std::uint8_t>(f.octave)});
    set.descriptors.push_back(f.descriptor);
    u_right.push_back(f.u_right);
  }
  return {camera, std::move(set), std::move(u_right), {}};
}

}  // namespace kys_slam::testing
