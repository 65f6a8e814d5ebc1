// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "map/keyframe_message.h"
#include "map/landmark_id_allocator.h"
#include "map/replica.h"
#include "matching/descriptor_matcher.h"
#include "matching/landmark_search.h"
#include "motion/instance_tracker.h"
#include "optimization/pose_consensus.h"
#include "tracking/landmark_patches.h"
#include "tracking/local_map.h"
#include "tracking/picture_clock.h"
#include "tracking/tracker_options.h"
#include "tracking/visibility_counts.h"

namespace kys_slam {

/// A frame from the front end.
struct TrackerInput {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  std::shared_ptr<const FrameFeatures> features;
  const ImagePyramid* left = nullptr;         ///< of the left image; null: features without images
  bool repeated = false;                      ///< the left image is that of the frame before
  std::span<const kys::Prior> segments = {};  ///< of the left image, with or without keypoints
};

enum class TrackingStatus : std::uint8_t { kStarted, kTracked, kLost };

/// Pose of a frame relative to a keyframe, so that it moves with the map.
struct FramePose {
  KeyFrameId reference;  ///< invalid: not connected to the map
  Rigid3 T_c_reference;
  double scale = 1;  ///< Map::scale at which it was measured

  /// T_c_reference in a map of another scale.
  [[nodiscard]] Rigid3 at_scale(double other) const { return scaled(T_c_reference, other / scale); }
};

/// Place and pose of a frame recognised in the map.
struct KnownPlace {
  KeyFrameId reference;
  Rigid3 T_c_w;
  std::vector<LandmarkId> landmarks;  ///< per feature; invalid: none
};

/// Priors of the features of an earlier frame, from segments that came after it was tracked.
struct LatePriors {
  std::int64_t frame = 0;
  std::optional<KeyFrameId> keyframe;  ///< that it became
  std::vector<kys::Prior> priors;      ///< one per feature
};

struct TrackTimes {
  double predict = 0;    ///< ms
  double local_map = 0;  ///< ms
  double keyframe = 0;   ///< ms
};

struct TrackResult {
  TrackingStatus status = TrackingStatus::kLost;
  bool relocalised = false;  ///< tracking failed, and relocalisation succeeded
  std::string reason;        ///< why it is lost, or how the pose was predicted
  double taken = 0;          ///< s, when its picture was taken: the time stamp without its jitter
  Rigid3 T_c_w;              ///< undefined when lost
  FramePose pose;
  int matches = 0;  ///< landmarks matched, outliers included
  int inliers = 0;
  bool held = false;       ///< the expected pose was used as a prior
  bool jumped = false;     ///< the pose found near the prediction needs an impossible acceleration
  bool overruled = false;  ///< image area gave another pose than the number of matches
  std::vector<InstanceState> instances;  ///< of the frame, when the mode uses belief
  TrackTimes times;
  kys::Statistics statistics;
  std::optional<KeyFrameMessage> keyframe;  ///< for the back end
};

/// Estimates the pose of every frame against its replica of the map and decides on keyframes.
/// Without threads: `track` depends on the frame, the replica and the last frame only.
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
  void continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end, bool frozen);

  /// Applies a change set to the replica; call it between two frames.
  void apply(ChangeSet changes) {
    patches_.apply(changes);
    map_moved_ |= changes.moved;
    replica_.apply(std::move(changes));
  }

  /// Priors that became known late; call it between two frames.
  /// \param instances beliefs after the last frame, as if they had been known in time
  /// \param judged poses of the frames it keeps, latest first
  void apply(std::vector<LatePriors> late, const InstanceTracker& instances,
             std::deque<FramePose> judged);
  /// Those of keyframes that no message has had yet.
  [[nodiscard]] std::vector<KeyFramePriors> take_late_priors() { return std::exchange(late_, {}); }
  /// Beliefs after the last frame; null: the mode has none.
  [[nodiscard]] const InstanceTracker* instances() const {
    return instances_ ? &*instances_ : nullptr;
  }
  /// Poses of the frames that the beliefs keep, latest first.
  [[nodiscard]] const std::deque<FramePose>& judged_poses() const { return judged_; }

  [[nodiscard]] const Replica& replica() const { return replica_; }
  /// The features, with what is believed of instances now in place of what their file says; as they
  /// are when the mode uses no belief.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> with_beliefs(
      std::shared_ptr<const FrameFeatures> features) const;
  /// The same for one prior.
  [[nodiscard]] kys::Prior with_belief(const kys::Prior& prior) const {
    return instances_ ? instances_->with_belief(prior) : prior;
  }
  /// Landmarks of the last frame with a pose, per feature; invalid: none.
  [[nodiscard]] std::span<const LandmarkId> last_landmarks() const {
    return last_ ? std::span<const LandmarkId>(last_->landmarks) : std::span<const LandmarkId>();
  }
  /// T_c_w of an earlier frame, from the present pose of its keyframe in the replica.
  [[nodiscard]] Rigid3 current_pose(const FramePose& pose) const;
  /// Sub-map of a keyframe in the replica.
  [[nodiscard]] KeyFrameId submap(KeyFrameId keyframe) const;

 private:
  struct Frame {
    std::int64_t index = 0;
    double timestamp = 0;
    double taken = 0;  // s, when the camera was where the picture shows it: Tracker::taken_at
    std::shared_ptr<const FrameFeatures> features;
    std::vector<LandmarkId> landmarks;  // per feature
    Rigid3 T_c_w;
    FramePose pose;
    std::optional<PosePrior> held;         // by the expected pose
    const ImagePyramid* left = nullptr;    // while the frame is tracked
    std::span<const kys::Prior> segments;  // while the frame is tracked

    [[nodiscard]] int landmark_count() const {
      return static_cast<int>(std::ranges::count_if(landmarks, &LandmarkId::valid));
    }
  };

  Frame make_frame(const TrackerInput& input, TrackResult& result);
  double taken_at(const TrackerInput& input);
  void start_map(Frame& frame, TrackResult& result);
  bool finish_tracked(Frame frame, int waiting, TrackResult& result);
  void refresh_last_frame();
  bool predict(Frame& frame, TrackResult& result);
  bool predict_by_motion(Frame& frame, TrackResult& result);
  bool predict_by_points(Frame& frame, TrackResult& result);
  [[nodiscard]] bool others_move_along(const Frame& frame,
                                       const std::vector<LandmarkId>& matched) const;
  void replace_misfit(Frame& frame, TrackResult& result);
  bool replace_jump(Frame& frame, TrackResult& result, double least_share = 0);
  void replace(Frame& frame, TrackResult& result, Frame other, const TrackResult& found);
  bool predict_by_reference(Frame& frame, TrackResult& result, std::size_t every = 1);
  bool predict_by_map(Frame& frame, TrackResult& result);
  struct Unpredicted {
    std::span<const DescriptorQuery> queries;
    std::span<const LandmarkId> landmarks;  // per query
    const char* name = "";
    bool angles = false;
    bool expects = true;  // the camera to go on as it did
  };
  bool predict_by_descriptor(Frame& frame, const Unpredicted& asked, TrackResult& result);
  bool track_local_map(Frame& frame, TrackResult& result);
  int match_last_frame(Frame& frame, float radius, TrackResult& result);
  void match_local_landmarks(Frame& frame, const LocalMap& local, TrackResult& result);
  int refine_pose(Frame& frame, TrackResult& result, bool expects = true) const;
  [[nodiscard]] StereoPixel pixel_of(const Frame& frame, std::size_t feature,
                                     const LandmarkView& landmark) const;
  [[nodiscard]] StereoPixel pixel_of(const Frame& frame, std::size_t feature,
                                     std::size_t observations) const;
  [[nodiscard]] PoseObservation observation(const Frame& frame, std::size_t feature,
                                            const LandmarkView& landmark) const;
  [[nodiscard]] PoseObservation observation(const Frame& frame, std::size_t feature,
                                            const Eigen::Vector3d& p_w,
                                            std::size_t observations) const;
  [[nodiscard]] Vote vote(const kys::Prior& keypoint, const kys::Prior& landmark) const;
  [[nodiscard]] int count_addable(const Frame& frame) const;
  [[nodiscard]] KeyFrameSituation situation(const Frame& frame, int inliers, int waiting) const;
  KeyFrameMessage make_keyframe(Frame& frame);
  [[nodiscard]] std::optional<ExpectedMotion> expected_motion(const Frame& frame) const;
  void add_stereo_landmarks(const Frame& frame, KeyFrameMessage& message);
  [[nodiscard]] LandmarkView first_view(const Frame& frame, std::size_t feature,
                                        const Eigen::Vector3d& p_w, KeyFrameId keyframe) const;
  void judge_instances(Frame& frame, TrackResult& result);
  void forget_instance_frames();
  [[nodiscard]] const kys::Prior* prior_of(const LandmarkView& landmark,
                                           std::deque<kys::Prior>& kept) const;
  [[nodiscard]] float belief(const kys::Prior& prior) const {
    return instances_ ? instances_->weight(prior) : 1.0f;
  }
  /// Whether the belief that its instance is static passes the gate (kys.gate_belief), so that it
  /// can be part of the map.
  [[nodiscard]] bool is_believed_static(const kys::Prior& prior) const {
    return !instances_ || model_->admits(instances_->with_belief(prior), kys::Context::kTemporal);
  }
  // s; the motion model predicts for this long while frames are lost or a picture is repeated.
  static constexpr double kLongestGuess = 0.5;
  static constexpr float kMostSteps = 3;  // that widen the search around an expected pixel
  [[nodiscard]] std::optional<ExpectedPose> expected_pose(double taken,
                                                          double longest = kLongestGuess) const;
  [[nodiscard]] bool is_expected(const Frame& frame) const;
  [[nodiscard]] bool is_jump(const Frame& frame, double steps = 0) const;
  [[nodiscard]] bool is_supported(const Frame& frame);
  bool is_possible(const Frame& frame, TrackResult& result) const;
  void keep_as_last(Frame frame, TrackResult& result);

  StereoCamera camera_;
  ScaleLevels scales_;
  TrackerOptions options_;
  const kys::DistanceModel* model_;
  kys::InitialBelief start_;
  float close_depth_;  // m

  Replica replica_;
  bool map_moved_ = false;  // as by a loop, since the last frame was refreshed
  LandmarkPatches patches_;
  LocalMapGatherer local_map_gatherer_;
  bool doubtful_ = false;      // the pose predicted by motion
  bool impossible_ = false;    // it needs an impossible acceleration
  double share_ = 0;           // inliers as a share of the matches of the last prediction
  std::optional<Frame> last_;  // last frame with a pose
  struct Velocity {
    Rigid3 T_c_last;
    double interval = 0;  // s
    double taken = 0;     // s, of the later frame
  };
  std::optional<Velocity> velocity_;  // of the last two tracked frames, perhaps of another sub-map
  double latest_ = 0;                 // s, of the last frame
  std::optional<double> labelled_;    // s, of the last frame with priors; for beliefs only
  std::optional<double> supported_;   // s, when the fixed scene last supported a pose
  PictureClock clock_;
  KeyFrameId reference_;  // keyframe that shares most with the last frame
  KeyFrameId last_keyframe_;
  KeyFrameId first_keyframe_;  // of the sub-map being tracked, or at which tracking resumed
  std::int64_t last_keyframe_frame_ = 0;
  std::uint32_t next_keyframe_ = 0;
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kTracker};
  bool frozen_ = false;                       // no keyframes, no landmarks
  VisibilityCounts counts_;                   // since the last keyframe
  std::optional<InstanceTracker> instances_;  // when the model uses belief
  std::deque<FramePose> judged_;              // of the frames it keeps, latest first
  std::vector<KeyFramePriors> late_;          // for the next message
};

}  // namespace kys_slam
