// SPDX-License-Identifier: BSD-3-Clause
#include "frame_priors.h"

#include <fmt/format.h>
#include <kys_slam/error.h>

namespace kys_slam {

bool FramePriors::look_up(const StereoFrame& frame, std::span<const Keypoint> left,
                          std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
                          std::vector<kys::Prior>& right_priors) {
  if (!frame.has_priors) {
    ++missing_;
    return false;
  }
  if (frame.left_priors.size() != left.size() || frame.right_priors.size() != right.size()) {
    throw InputError(fmt::format("frame {}: features and priors differ in number", frame.index));
  }
  left_priors = frame.left_priors;
  right_priors = frame.right_priors;
  return true;
}

}  // namespace kys_slam
