#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

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
#include "tracking/keyframe_policy.h"
#include "tracking/landmark_patches.h"
#include "tracking/local_map.h"

namespace kys_slam {

struct TrackerOptions {
  int min_start_points = 100;   ///< stereo points needed to start a map
  double close_baselines = 40;  ///< points nearer than this many baselines are close
  float motion_radius = 7;      ///< px at octave 0, search around the predicted pixel
  int min_motion_matches = 10;  ///< below this the radius is doubled, then the model given up
  int min_reference_matches = 15;
  int min_pose_inliers = 10;      ///< after the first pose of a frame
  int min_local_inliers = 30;     ///< after the local map; fewer: lost
  int min_held_inliers = 15;      ///< the same where the pose is where constant velocity leads
  float local_radius = 1;         ///< factor on the search radius of local landmarks
  float local_ratio = 0.8f;       ///< best / second best
  float max_distance = 100;       ///< bits
  float reference_distance = 50;  ///< bits, matching without prediction
  float reference_ratio = 0.7f;
  double acceleration =
      3;  ///< m/s^2, standard deviation: holds a pose that little else does; 0: off
  double turn_acceleration = 3;  ///< rad/s^2, the same of the rotation
  bool align = true;           ///< keypoints with their landmarks' patches, where there are images
  ConsensusOptions consensus;  ///< the pose by image area, not by matches
  KeyFramePolicyOptions keyframes;
  InstanceTrackerOptions instances;  ///< used when the model wants belief
};
/// For check_options().
void describe(kys::OptionList& list, TrackerOptions& options);

/// A frame as the front end made it.
struct TrackerInput {
  std::int64_t index = 0;
  double timestamp = 0;  ///< s
  std::shared_ptr<const FrameFeatures> features;
  const ImagePyramid* left = nullptr;  ///< of the left image; null: features without images
};

enum class TrackingStatus : std::uint8_t { kStarted, kTracked, kLost };

/// Where a frame is: relative to a keyframe, so that it moves with the map.
struct FramePose {
  KeyFrameId reference;  ///< invalid: not connected to the map
  Rigid3 T_c_reference;
};

/// Where a frame was recognised in the map.
struct KnownPlace {
  KeyFrameId reference;
  Rigid3 T_c_w;
  std::vector<LandmarkId> landmarks;  ///< per feature; invalid: none
};

struct TrackTimes {
  double predict = 0;    ///< ms
  double local_map = 0;  ///< ms
  double keyframe = 0;   ///< ms
};

struct TrackResult {
  TrackingStatus status = TrackingStatus::kLost;
  bool relocalised = false;  ///< lost, but recognised in the map
  std::string reason;        ///< why it is lost, or how the pose was predicted
  Rigid3 T_c_w;              ///< meaningful unless lost
  FramePose pose;
  int matches = 0;  ///< landmarks matched, before outliers went
  int inliers = 0;
  bool held = false;       ///< the expected pose joined the matches
  bool jumped = false;     ///< no camera can have come to the pose found near the expected one
  bool overruled = false;  ///< image area decided against the number of matches
  std::vector<InstanceState> instances;  ///< things in the frame, when belief is kept
  TrackTimes times;
  kys::Statistics statistics;
  std::optional<KeyFrameMessage> keyframe;  ///< for the back end
};

/// Estimates the pose of every frame against its replica of the map and decides on keyframes.
/// Knows nothing of threads: `track` is a function of the frame, the replica and the last frame.
class Tracker {
 public:
  /// \param model has to outlive the tracker
  /// \param start which things can move, and where belief in their standing still starts
  Tracker(const StereoCamera& camera, const ScaleLevels& scales, const TrackerOptions& options,
          const kys::DistanceModel& model, const kys::BeliefStart& start = {});

  /// \param waiting keyframes sent to the back end whose change set has not been applied
  TrackResult track(const TrackerInput& input, int waiting);

  /// Tracks a frame that `track` lost but that was recognised in the map (relocalisation).
  TrackResult resume(const TrackerInput& input, const KnownPlace& place, int waiting);
  /// Starts a new sub-map with a frame that `track` lost, at the origin of its own world.
  TrackResult start_submap(const TrackerInput& input);
  /// Is there a map a lost frame could be looked for in?
  [[nodiscard]] bool knows_a_map() const { return !replica_.keyframes().empty(); }
  /// Enough stereo points to start a map?
  [[nodiscard]] bool can_start(const FrameFeatures& features) const;

  /// Before the first frame: the ids of what it makes begin here, and it makes nothing at all when
  /// the map is `frozen`.
  void continue_map(std::uint32_t keyframe_id_end, std::uint32_t landmark_id_end, bool frozen);

  /// Brings the replica up to date; between two frames.
  void apply(ChangeSet changes) {
    patches_.apply(changes);
    replica_.apply(std::move(changes));
  }

  [[nodiscard]] const Replica& replica() const { return replica_; }
  /// Landmarks of the last frame with a pose, per feature; invalid: none.
  [[nodiscard]] std::span<const LandmarkId> last_landmarks() const {
    return last_ ? std::span<const LandmarkId>(last_->landmarks) : std::span<const LandmarkId>();
  }
  /// T_c_w of a frame tracked earlier, as the replica has its keyframe now.
  [[nodiscard]] Rigid3 current_pose(const FramePose& pose) const;
  /// Sub-map of a keyframe as the replica knows it.
  [[nodiscard]] KeyFrameId submap(KeyFrameId keyframe) const;

 private:
  struct Frame {
    std::int64_t index = 0;
    double timestamp = 0;
    std::shared_ptr<const FrameFeatures> features;
    std::vector<LandmarkId> landmarks;  // per feature
    Rigid3 T_c_w;
    FramePose pose;
    const ImagePyramid* left = nullptr;  // while the frame is tracked
  };

  Frame make_frame(const TrackerInput& input);
  void start_map(Frame& frame, TrackResult& result);
  bool finish_tracked(Frame frame, int waiting, TrackResult& result);
  void refresh_last_frame();
  bool predict(Frame& frame, TrackResult& result);
  bool predict_by_motion(Frame& frame, TrackResult& result);
  void replace_misfit(Frame& frame, TrackResult& result);
  bool replace_jump(Frame& frame, TrackResult& result, double least_share = 0);
  void replace(Frame& frame, TrackResult& result, Frame other, const TrackResult& found);
  bool predict_by_reference(Frame& frame, TrackResult& result, std::size_t every = 1);
  bool predict_by_map(Frame& frame, TrackResult& result);
  bool predict_by_descriptor(Frame& frame, const std::vector<DescriptorQuery>& queries,
                             const std::vector<LandmarkId>& landmarks, bool angles,
                             const char* name, TrackResult& result);
  bool track_local_map(Frame& frame, TrackResult& result);
  int match_last_frame(Frame& frame, float radius, TrackResult& result);
  void match_local_landmarks(Frame& frame, const LocalMap& local, TrackResult& result);
  int refine_pose(Frame& frame, TrackResult& result) const;
  [[nodiscard]] Vote vote(const kys::Prior& keypoint, const kys::Prior& landmark) const;
  [[nodiscard]] int count_addable(const Frame& frame) const;
  [[nodiscard]] KeyFrameSituation situation(const Frame& frame, int inliers, int waiting) const;
  KeyFrameMessage make_keyframe(Frame& frame);
  void add_stereo_landmarks(const Frame& frame, KeyFrameMessage& message);
  [[nodiscard]] LandmarkView first_view(const Frame& frame, std::size_t feature,
                                        const Eigen::Vector3d& p_w, KeyFrameId keyframe) const;
  void judge_instances(Frame& frame, TrackResult& result);
  void lose_instances();
  [[nodiscard]] const kys::Prior* prior_of(const LandmarkView& landmark,
                                           std::deque<kys::Prior>& kept) const;
  [[nodiscard]] float belief(const kys::Prior& prior) const {
    return instances_ ? instances_->weight(prior) : 1.0f;
  }
  /// Is it believed enough to be part of the map?
  [[nodiscard]] bool stands(const kys::Prior& prior) const {
    return !instances_ || model_->admits(instances_->believed(prior), kys::Context::kTemporal);
  }
  void count_visible(LandmarkId id);
  [[nodiscard]] std::optional<ExpectedPose> expected_pose(double timestamp) const;
  [[nodiscard]] bool is_expected(const Frame& frame) const;
  [[nodiscard]] bool is_jump(const Frame& frame) const;
  void keep_as_last(Frame frame, TrackResult& result);

  StereoCamera camera_;
  ScaleLevels scales_;
  TrackerOptions options_;
  const kys::DistanceModel* model_;
  kys::BeliefStart start_;
  float close_depth_;  // m

  Replica replica_;
  LandmarkPatches patches_;
  LocalMapGatherer local_map_gatherer_;
  bool doubtful_ = false;      // the pose predicted by motion
  bool impossible_ = false;    // no camera can have come to it
  double share_ = 0;           // of the matches that led to the last prediction, those that fit
  std::optional<Frame> last_;  // last frame with a pose
  struct Velocity {
    Rigid3 T_c_last;
    double interval = 0;   // s
    double timestamp = 0;  // s, of the later frame
  };
  std::optional<Velocity> velocity_;  // of the last two tracked frames, perhaps of another sub-map
  int repeats_ = 0;                   // frames in a row that show the last one's picture again
  KeyFrameId reference_;              // keyframe that shares most with the last frame
  KeyFrameId last_keyframe_;
  KeyFrameId first_keyframe_;  // of the sub-map being tracked, or at which tracking resumed
  std::int64_t last_keyframe_frame_ = 0;
  std::uint32_t next_keyframe_ = 0;
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kTracker};
  bool frozen_ = false;  // no keyframes, no landmarks
  IdTable<LandmarkId, VisibilityCount> counts_;
  std::optional<InstanceTracker> instances_;  // when the model wants belief
  std::deque<FramePose> judged_;              // of the frames it keeps, latest first
};

}  // namespace kys_slam
