// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "map/replica.h"
#include "tracking/frame_instances.h"
#include "tracking/integrity_check.h"
#include "tracking/keyframe_maker.h"
#include "tracking/landmark_patches.h"
#include "tracking/local_map.h"
#include "tracking/motion_model.h"
#include "tracking/pose_judge.h"
#include "tracking/replica_poses.h"
#include "tracking/track_result.h"
#include "tracking/tracked_frame.h"
#include "tracking/tracker_input.h"
#include "tracking/tracker_options.h"

namespace kys_slam {

/// Estimates the pose of every frame against its replica of the map and decides on keyframes.
/// Without threads: `track` depends on the frame, the replica and the last frame only.
///
/// The steps of a frame: PoseJudge finds a first pose from its sources, refine_with_local_map()
/// improves it, PoseJudge accepts it or not, FrameInstances judges what moves, KeyFrameMaker makes
/// a keyframe when one is due. The tracker owns what lasts from frame to frame, and none of the
/// rules.
class Tracker {
 public:
  /// \param model must outlive the tracker
  /// \param start initial beliefs of instances by class and flag
  Tracker(const StereoCamera& camera, const ScaleLevels& scales, const TrackerOptions& options,
          const kys::DistanceModel& model, const kys::InitialBelief& start = {});

  /// \param waiting keyframes sent to the back end whose change set has not been applied
  TrackResult track(const TrackerInput& input, int waiting);
  /// Tracks a frame that `track` lost and relocalisation found in the map.
  TrackResult resume(const TrackerInput& input, const KnownPlace& place, int waiting);
  /// Starts a new sub-map with a frame that `track` lost, at the origin of its own world.
  TrackResult start_submap(const TrackerInput& input);
  /// Whether there is a map in which a lost frame can be relocalised.
  [[nodiscard]] bool has_map() const { return !replica_.keyframes().empty(); }
  /// Whether a map can start with the last frame: it has enough stereo points, and with beliefs it
  /// has priors if frames shortly before had some.
  [[nodiscard]] bool can_start(const FrameFeatures& features) const;

  /// Continues a loaded map; call it before the first frame. New ids begin at the given ones. With
  /// `frozen` the tracker creates no keyframes and no landmarks.
  void continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end, bool frozen) {
    keyframes_.continue_map(keyframe_id_end, landmark_id_end, frozen);
  }
  /// Applies a change set to the replica; call it between two frames.
  void apply(ChangeSet changes);
  /// Priors that became known late; call it between two frames.
  /// \param instances beliefs after the last frame, as if they had been known in time
  /// \param judged poses of the frames it keeps, latest first
  void apply(std::vector<LatePriors> late, const InstanceTracker& instances,
             std::deque<FramePose> judged);
  /// Late priors of keyframes that no message has had yet.
  [[nodiscard]] std::vector<KeyFramePriors> take_late_priors() { return std::exchange(late_, {}); }
  [[nodiscard]] const FrameInstances& instances() const { return instances_; }

  [[nodiscard]] const Replica& replica() const { return replica_; }
  /// The features, with what is believed of instances now in place of what their file says; as they
  /// are when the mode uses no belief.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> with_beliefs(
      std::shared_ptr<const FrameFeatures> features) const {
    return instances_.with_beliefs(std::move(features));
  }
  /// The same for one prior.
  [[nodiscard]] kys::Prior with_belief(const kys::Prior& prior) const {
    return instances_.beliefs().with_belief(prior);
  }
  /// Landmarks of the last frame with a pose, per feature; invalid: none.
  [[nodiscard]] std::span<const LandmarkId> last_landmarks() const {
    return last_ ? std::span<const LandmarkId>(last_->landmarks) : std::span<const LandmarkId>();
  }
  /// T_c_w of an earlier frame, from the present pose of its keyframe in the replica.
  [[nodiscard]] Rigid3 current_pose(const FramePose& pose) const {
    return kys_slam::current_pose(replica_, pose);
  }
  /// Sub-map of the last frame with a pose; invalid: there is none.
  [[nodiscard]] KeyFrameId present_submap() const {
    return reference_.valid() ? submap_of(replica_, reference_) : KeyFrameId{};
  }
  /// Sub-map of a keyframe in the replica.
  [[nodiscard]] KeyFrameId submap(KeyFrameId keyframe) const {
    return submap_of(replica_, keyframe);
  }

 private:
  [[nodiscard]] TrackingContext context();
  [[nodiscard]] TrackedFrame make_frame(const TrackerInput& input, TrackResult& result);
  void refresh_last_frame();
  void start_map(TrackedFrame& frame, TrackResult& result);
  bool use_local_map(TrackedFrame& frame, PoseCandidate& candidate, TrackResult& result);
  bool finish_tracked(TrackedFrame frame, PoseCandidate candidate, int waiting,
                      TrackResult& result);
  void drop_moving(TrackedFrame& frame, PoseCandidate& candidate);
  KeyFrameMessage make_keyframe(TrackedFrame& frame);
  void keep_as_last(TrackedFrame frame, TrackResult& result);

  StereoCamera camera_;
  ScaleLevels scales_;
  TrackerOptions options_;
  const kys::DistanceModel* model_;

  Replica replica_;
  bool map_moved_ = false;  // as by a loop, since the last frame was refreshed
  LandmarkPatches patches_;
  FrameCovariance covariance_;
  LocalMapGatherer local_map_gatherer_;
  PoseJudge judge_;
  MotionModel motion_;
  FrameInstances instances_;
  IntegrityCheck integrity_;
  KeyFrameMaker keyframes_;
  std::optional<TrackedFrame> last_;  // last frame with a pose
  KeyFrameId reference_;              // keyframe that shares most with it
  std::vector<KeyFramePriors> late_;  // for the next message
};

}  // namespace kys_slam
