#pragma once

#include <kys/distance.h>

#include <cstddef>
#include <cstdint>
#include <span>

namespace kys_slam {

/// How many keypoints get another prior from one set of files than from another (the robustness
/// study's exposure: an error where no keypoint lies does no harm).
struct Exposure {
  std::size_t keypoints = 0;
  std::size_t label = 0;          ///< another class, or void in one only
  std::size_t instance = 0;       ///< another identity or class
  std::size_t dynamic = 0;        ///< flagged as moving in one only
  std::size_t stereo_gate = 0;    ///< mu on the other side of 8
  std::size_t temporal_gate = 0;  ///< mu on the other side of 20
  std::size_t any = 0;            ///< any of label, dynamic, or a gate

  /// Both spans belong to the same keypoints.
  void add(std::span<const kys::Prior> reference, std::span<const kys::Prior> other);
  Exposure& operator+=(const Exposure& other);
};

}  // namespace kys_slam
