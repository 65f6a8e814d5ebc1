// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/error.h>
#include <kys_slam/prior_folder.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace kys_slam {

/// Priors of a frame as they were given with it, else of the folder, else those of its features.
/// With a folder those of features are not used, as in the C++ programs.
class GivenPriors final : public PriorProvider {
 public:
  bool look_up(const StereoFrame& frame, std::span<const Keypoint> left,
               std::span<const Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override {
    segments_ = {};
    if (given) {
      segments_ = given->segment_priors(CameraSide::kLeft);
      left_priors.resize(left.size());
      right_priors.resize(right.size());
      given->lookup(CameraSide::kLeft, left, left_priors);
      given->lookup(CameraSide::kRight, right, right_priors);
      return true;
    }
    if (folder) {
      if (!folder->look_up(frame, left, right, left_priors, right_priors)) return false;
      segments_ = folder->segments();
      return true;
    }
    if (!frame.has_priors) {
      ++without_;
      return false;
    }
    if (frame.left_priors.size() != left.size() || frame.right_priors.size() != right.size()) {
      throw InputError("frame " + std::to_string(frame.index) +
                       ": features and priors differ in number");
    }
    ++of_features_;
    left_priors = frame.left_priors;
    right_priors = frame.right_priors;
    return true;
  }
  [[nodiscard]] std::span<const kys::Prior> segments() const override { return segments_; }

  /// Frames without priors where others have some.
  [[nodiscard]] std::int64_t missing() const {
    if (folder) return static_cast<std::int64_t>(folder->missing());
    return of_features_ > 0 ? without_ : 0;
  }

  std::unique_ptr<PriorFolder> folder;
  std::optional<PriorFile> given;

 private:
  std::int64_t without_ = 0, of_features_ = 0;  // frames
  std::span<const kys::Prior> segments_;
};

}  // namespace kys_slam
