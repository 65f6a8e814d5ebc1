// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/prior_provider.h>

#include <cstdint>

namespace kys_slam {

/// The priors in the frames of a feature file.
class FramePriors : public PriorProvider {
 public:
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override;

  /// Number of frames without priors.
  [[nodiscard]] std::int64_t missing() const { return missing_; }

 private:
  std::int64_t missing_ = 0;
};

}  // namespace kys_slam
