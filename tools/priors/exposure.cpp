// SPDX-License-Identifier: BSD-3-Clause
#include "exposure.h"

namespace kys_slam {

void Exposure::add(std::span<const kys::Prior> reference, std::span<const kys::Prior> other) {
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const kys::Prior &a = reference[i], &b = other[i];
    const bool wrong_label = a.label != b.label;
    const bool wrong_flag = a.dynamic != b.dynamic;
    const bool wrong_stereo = (a.motion > 8) != (b.motion > 8);
    const bool wrong_temporal = (a.motion > 20) != (b.motion > 20);
    ++keypoints;
    label += wrong_label;
    instance += wrong_label || a.instance != b.instance;
    dynamic += wrong_flag;
    stereo_gate += wrong_stereo;
    temporal_gate += wrong_temporal;
    any += wrong_label || wrong_flag || wrong_stereo || wrong_temporal;
  }
}

Exposure& Exposure::operator+=(const Exposure& other) {
  keypoints += other.keypoints;
  label += other.label;
  instance += other.instance;
  dynamic += other.dynamic;
  stereo_gate += other.stereo_gate;
  temporal_gate += other.temporal_gate;
  any += other.any;
  return *this;
}

}  // namespace kys_slam
