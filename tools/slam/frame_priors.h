#pragma once

#include <kys_slam/prior_provider.h>

#include <cstdint>

namespace kys_slam {

/// The priors that a feature file's frames bring along.
class FramePriors : public PriorProvider {
 public:
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override;

  /// Frames that came without.
  [[nodiscard]] std::int64_t missing() const { return missing_; }

 private:
  std::int64_t missing_ = 0;
};

}  // namespace kys_slam
