// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "priors/fusion/fuse.h"

namespace kys_slam {

/// Evidence of one frame for a segment, nats; > 0: it moves.
struct MotionEvidence {
  double flow = 0;        ///< median residual against its threshold
  double appearance = 0;  ///< the next image confirms the static flow or the observed one
  double keypoints = 0;   ///< stereo keypoints tracked over time
  double space = 0;       ///< its position was free before; never < 0
  [[nodiscard]] bool any() const {
    return flow != 0 || appearance != 0 || keypoints != 0 || space != 0;
  }
};

/// Evidence of detection.method robust. The evidence of each source is limited, and a source that
/// another one contradicts is not used: optical flow that the next image does not confirm gives no
/// evidence, and a changed appearance alone (an occlusion, for example) is no evidence of motion.
MotionEvidence motion_evidence(const BuilderOptions::Detection& options,
                               const SegmentStatistics& segment,
                               const BackgroundReferences& background);

/// Log-odds of moving of every object over time. Evidence of both cameras is added where they share
/// instances, and without evidence the belief returns to its initial value (motion/belief.h). The
/// decision of a frame also uses the evidence of `detection.lag` later frames (fixed-lag smoothing
/// of a two-state Markov chain). Frames are added in order and decided in the same order.
class MotionBelief {
 public:
  /// \param shares_instances  an object has the same instance in both cameras, plus
  ///   prior_format::kRightInstances in the right one; otherwise instances of the two cameras are
  ///   not related
  MotionBelief(const BuilderOptions::Detection& options, bool shares_instances)
      : options_(options), shares_instances_(shares_instances) {}

  /// Adds the evidence of a frame.
  /// \param timestamp s
  /// \param cameras left, right; the evidence goes into their decisions
  /// \param instances of their segments
  void add_frame(double timestamp, std::span<CameraFusion* const> cameras,
                 std::span<const std::vector<std::int32_t>* const> instances);
  /// The same for a frame decided in an earlier run: its instances and their `evidence`, nats.
  void restore_frame(double timestamp,
                     const std::vector<std::pair<std::int32_t, double>>& evidence);
  /// Decides the earliest undecided frame, from it and all frames added after it. For a restored
  /// frame `cameras` is empty.
  void decide(std::span<CameraFusion* const> cameras,
              std::span<const std::vector<std::int32_t>* const> instances);

 private:
  struct State {
    double log_odds = 0;   // of moving, by the frames so far
    double timestamp = 0;  // s
  };
  struct FrameEvidence {
    double evidence = 0;  // nats
    double log_odds = 0;  // of moving, by the frames so far and this one
    bool any = false;     // something was measured
  };
  struct Frame {
    double timestamp = 0;                            // s
    std::map<std::int32_t, FrameEvidence> evidence;  // by object
  };
  [[nodiscard]] std::int32_t object_of(std::int32_t instance) const;
  [[nodiscard]] double expected(std::int32_t object, double timestamp) const;
  void add(Frame frame);
  [[nodiscard]] double later(std::int32_t object) const;

  BuilderOptions::Detection options_;
  bool shares_instances_;
  std::map<std::int32_t, State> states_;  // by object_of()
  std::deque<Frame> frames_;              // not decided, earliest first
};

}  // namespace kys_slam
