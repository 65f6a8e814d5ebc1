// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>

#include <optional>
#include <string>

#include "tracking/pose_candidate.h"

namespace kys_slam {

struct TrackedFrame;
struct TrackingContext;

/// The pose from which the local map is searched, and how it was found.
struct Prediction {
  std::optional<PoseCandidate> candidate;
  std::string trail;    ///< the sources that were tried and what was doubted, for the user
  bool jumped = false;  ///< a candidate needed an impossible acceleration
  kys::Statistics statistics;
};

/// Why a pose does not stand.
struct Objection {
  std::string why;       ///< "": it stands
  bool refused = false;  ///< it has enough inliers, and what they are on is not believed
};

/// The rules by which the pose of a frame is found. Nothing else decides which source is tried
/// next, which candidate is taken and whether the frame is lost.
///
/// The usual frame tries one source: landmarks of the last frame near the expected pose. Its
/// candidate is doubted when it needs an impossible acceleration, or when its share of inliers has
/// fallen. A doubted candidate competes with one that was found without an expectation; the one
/// that explains more matches stands. So a sudden reversal is followed, and an object that moves
/// along with the camera is not.
class PoseJudge {
 public:
  /// A pose of a frame, given a last frame with a pose.
  Prediction predict(const TrackingContext& context, const TrackedFrame& frame);

  /// Whether the pose stands that the local map gave.
  Objection objection(const TrackingContext& context, const TrackedFrame& frame,
                      const PoseCandidate& candidate);
  /// Whether a pose found without an expectation is possible after the last motion. When a moving
  /// object fills the image, all matches may be on it. Then the frame has no pose, for as long as
  /// the motion model is used.
  [[nodiscard]] bool is_possible(const TrackingContext& context, const TrackedFrame& frame,
                                 const Rigid3& T_c_w) const;
  /// Forgets what the scene said in another world.
  void start_map() { supported_.reset(); }

 private:
  struct Doubt {
    bool impossible = false;  // it needs an impossible acceleration
    bool fallen = false;      // its share of inliers is low
  };
  [[nodiscard]] Doubt doubt_about(const TrackingContext& context, const TrackedFrame& frame,
                                  const PoseCandidate& candidate, double share_before) const;
  [[nodiscard]] bool others_move_along(const TrackingContext& context, const TrackedFrame& frame,
                                       const PoseCandidate& candidate) const;
  void find_unexpected(const TrackingContext& context, const TrackedFrame& frame, bool expected,
                       Prediction& prediction) const;
  void compare_with_reference(const TrackingContext& context, const TrackedFrame& frame,
                              const Doubt& doubt, Prediction& prediction);
  bool replace_by_map(const TrackingContext& context, const TrackedFrame& frame, double least_share,
                      Prediction& prediction);
  void replace(Attempt attempt, const char* doubted, Prediction& prediction);
  bool is_supported(const TrackingContext& context, const TrackedFrame& frame,
                    const PoseCandidate& candidate);

  double share_ = 0;                 // of inliers in the matches of the last prediction
  std::optional<double> supported_;  // s, when the fixed scene last supported a pose
};

}  // namespace kys_slam
