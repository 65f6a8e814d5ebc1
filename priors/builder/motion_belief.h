#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "priors/builder/fuse.h"

namespace kys_slam {

/// What one frame says about a segment, nats; > 0: it moves.
struct MotionEvidence {
  double flow = 0;        ///< median residual against its threshold
  double appearance = 0;  ///< where the next image looks the same
  double keypoints = 0;   ///< stereo keypoints followed in time
  [[nodiscard]] bool any() const { return flow != 0 || appearance != 0 || keypoints != 0; }
};

/// detection.method: robust. Each source is limited, and a source that another contradicts is not
/// counted: optical flow that the next image does not confirm says nothing, and a place that only
/// looks different (something came in front of it) does not make a thing move.
MotionEvidence motion_evidence(const BuilderOptions::Detection& options,
                               const SegmentStatistics& segment,
                               const BackgroundReferences& background);

/// Log-odds of moving of every thing, over time: evidence of both cameras adds up, and belief
/// returns to where it began as the tracker's does (motion/belief.h).
class MotionBelief {
 public:
  explicit MotionBelief(const BuilderOptions::Detection& options) : options_(options) {}

  /// Decides the segments of the next frame. \param timestamp s  \param cameras left, right
  /// \param instances of their segments
  void next_frame(double timestamp, std::span<CameraFusion* const> cameras,
                  std::span<const std::vector<std::int32_t>* const> instances);
  /// Instead, for a frame that was decided before: what it left behind.
  void restore(double timestamp, std::int32_t instance, double log_odds);

 private:
  struct State {
    double log_odds = 0;   // of moving
    double timestamp = 0;  // s
  };
  [[nodiscard]] double expected(std::int32_t object, double timestamp) const;

  BuilderOptions::Detection options_;
  std::map<std::int32_t, State> states_;  // by instance without its camera
};

}  // namespace kys_slam
