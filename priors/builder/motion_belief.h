#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "priors/builder/fuse.h"

namespace kys_slam {

/// What one frame says about a segment, nats; > 0: it moves.
struct MotionEvidence {
  double flow = 0;        ///< median residual against its threshold
  double appearance = 0;  ///< where the next image looks the same
  double keypoints = 0;   ///< stereo keypoints followed in time
  double space = 0;       ///< its place was free before; never < 0
  [[nodiscard]] bool any() const {
    return flow != 0 || appearance != 0 || keypoints != 0 || space != 0;
  }
};

/// detection.method: robust. Each source is limited, and a source that another contradicts is not
/// counted: optical flow that the next image does not confirm says nothing, and a place that only
/// looks different (something came in front of it) does not make a thing move.
MotionEvidence motion_evidence(const BuilderOptions::Detection& options,
                               const SegmentStatistics& segment,
                               const BackgroundReferences& background);

/// Log-odds of moving of every thing, over time: evidence of both cameras adds up, and belief
/// returns to where it began as the tracker's does (motion/belief.h). A frame's decision also looks
/// at the evidence of `detection.lag` later frames (fixed-lag smoothing of a chain of two states).
/// Frames are added in order, and decided in the same order.
class MotionBelief {
 public:
  explicit MotionBelief(const BuilderOptions::Detection& options) : options_(options) {}

  /// What a frame says. \param timestamp s  \param cameras left, right; the evidence goes into
  /// their decisions  \param instances of their segments
  void add_frame(double timestamp, std::span<CameraFusion* const> cameras,
                 std::span<const std::vector<std::int32_t>* const> instances);
  /// Instead, for a frame that was decided before: its instances and their `evidence`, nats.
  void restore_frame(double timestamp,
                     const std::vector<std::pair<std::int32_t, double>>& evidence);
  /// Decides the earliest frame that is not decided, by it and all those that were added after it.
  /// Of a restored frame there is nothing to decide: `cameras` is empty.
  void decide(std::span<CameraFusion* const> cameras,
              std::span<const std::vector<std::int32_t>* const> instances);

 private:
  struct State {
    double log_odds = 0;   // of moving, by the frames so far
    double timestamp = 0;  // s
  };
  struct Said {
    double evidence = 0;  // nats
    double log_odds = 0;  // of moving, by the frames so far and this one
    bool any = false;     // something was measured
  };
  struct Frame {
    double timestamp = 0;               // s
    std::map<std::int32_t, Said> said;  // by object
  };
  [[nodiscard]] double expected(std::int32_t object, double timestamp) const;
  void add(Frame frame);
  [[nodiscard]] double later(std::int32_t object) const;

  BuilderOptions::Detection options_;
  std::map<std::int32_t, State> states_;  // by object: an instance without its camera
  std::deque<Frame> frames_;              // not decided, earliest first
};

}  // namespace kys_slam
