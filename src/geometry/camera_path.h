// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <span>

namespace kys_slam {

/// Length of the way through the camera centres, m.
inline double camera_path_length(std::span<const Rigid3> T_c_w) {
  double length = 0;
  for (std::size_t k = 1; k < T_c_w.size(); ++k) {
    length += (T_c_w[k].inverse().t() - T_c_w[k - 1].inverse().t()).norm();
  }
  return length;
}

}  // namespace kys_slam
