// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>

#include <cstddef>
#include <cstdint>
#include <span>

namespace kys_slam {

/// Number of keypoints with different priors in two sets of files. This is the exposure of the
/// robustness study: an error at a pixel without a keypoint has no effect.
struct Exposure {
  std::size_t keypoints = 0;
  std::size_t label = 0;          ///< different class, or void in one only
  std::size_t instance = 0;       ///< different identity or class
  std::size_t dynamic = 0;        ///< flagged as moving in one only
  std::size_t stereo_gate = 0;    ///< mu on the other side of 8
  std::size_t temporal_gate = 0;  ///< mu on the other side of 20
  std::size_t any = 0;            ///< any of label, dynamic, or a gate

  /// Both spans belong to the same keypoints.
  void add(std::span<const kys::Prior> reference, std::span<const kys::Prior> other);
  Exposure& operator+=(const Exposure& other);
};

}  // namespace kys_slam
