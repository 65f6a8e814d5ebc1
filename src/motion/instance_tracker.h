#pragma once

#include <kys/belief.h>
#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "map/frame_features.h"
#include "map/instance_belief.h"
#include "motion/belief.h"
#include "motion/instance_motion.h"
#include "motion/leave_out.h"

namespace kys_slam {

struct InstanceTrackerOptions {
  InstanceMotionOptions motion;
  BeliefUpdateOptions belief;
  int max_frames = 5;               ///< frames back over which an instance is compared
  double kept_share = 0.6;          ///< of the matches to the last frame that a longer span keeps
  int max_matches = 60;             ///< keypoints of one instance followed from frame to frame
  double max_speed = 15;            ///< m/s, of things not seen to move before
  double max_turn = 0.5;            ///< rad/s
  double max_acceleration = 3;      ///< m/s^2, of things seen to move or to stand still
  double search_radius = 3.5;       ///< px at octave 0, around a predicted keypoint
  double max_search = 60;           ///< px, largest radius for things of unknown motion
  double descriptor_distance = 80;  ///< bits
  double descriptor_ratio = 0.85;   ///< best / second best
  double inherit_radius = 0.015;    ///< of the image's width: keypoints without a prior file take
                                    ///< that of the nearest predicted one
  double memory = 1.5;              ///< s without a file after which nothing is inherited any more
};
/// For check_options().
void describe(kys::OptionList& list, InstanceTrackerOptions& options);

/// An instance as it is in one frame.
struct InstanceState {
  std::int32_t instance = -1;
  std::uint16_t label = kys::kVoidLabel;
  double p_static = 1;
  int keypoints = 0;      ///< stereo keypoints on it in this frame
  int matches = 0;        ///< of these, followed from an earlier frame and used
  double log_ratio = 0;   ///< what this frame said, nats; > 0: stands still
  double span = 0;        ///< s between the two frames that were compared; 0: not compared
  InstanceMotion motion;  ///< meaningful when span > 0
};

/// Follows the things of the left image and believes in their standing still or moving. Two calls
/// per frame: `believe` before tracking gives every keypoint its prior with belief in it, `judge`
/// after tracking brings belief up to date with what the frame showed. Deterministic; of its
/// frames it keeps the last few.
class InstanceTracker {
 public:
  /// \param model has to outlive the tracker
  InstanceTracker(const StereoCamera& camera, const ScaleLevels& scales,
                  const InstanceTrackerOptions& options, const kys::BeliefStart& start,
                  const kys::DistanceModel& model);

  // Moved only: by_instance_ points into things_, whose nodes stay where they are.
  InstanceTracker(InstanceTracker&&) = default;
  InstanceTracker& operator=(InstanceTracker&&) = default;

  /// Priors of a frame's keypoints: those of its file, or where there is none, those of the nearest
  /// keypoints of the last frame, moved on. Belief stands in the place of motion.
  /// \param T_c_w_expected pose that the frame is expected to have
  /// \param T_last_w pose of the last frame given to `judge`, as the map has it now
  [[nodiscard]] std::vector<kys::Prior> believe(double timestamp, const FrameFeatures& features,
                                                const Rigid3& T_c_w_expected,
                                                const Rigid3& T_last_w);

  /// The frame given to `believe` last, tracked.
  /// \param features with the priors `believe` gave
  /// \param terms landmarks that took part in its pose; none: the pose is exact
  /// \param past T_c_w of the frames judged before, latest first, as the map has them now; at least
  ///   frames_kept() of them
  /// \return its things, by instance
  const std::vector<InstanceState>& judge(double timestamp,
                                          std::shared_ptr<const FrameFeatures> features,
                                          const Rigid3& T_c_w, std::span<const PoseTerm> terms,
                                          std::span<const Rigid3> past,
                                          kys::Statistics& statistics);
  /// The frame was lost: the next one is compared with nothing before it. Belief stays.
  void lose() { frames_.clear(); }
  [[nodiscard]] std::size_t frames_kept() const { return frames_.size(); }

  /// 1 for whatever is not followed.
  [[nodiscard]] double p_static(std::int32_t instance) const;
  /// Of standing still, nats; 0 for whatever is not followed.
  [[nodiscard]] double log_odds(std::int32_t instance) const;
  /// A landmark's or keypoint's prior with belief as it is now; stuff as it is.
  [[nodiscard]] kys::Prior believed(const kys::Prior& prior) const;
  /// The same as weight of an observation.
  [[nodiscard]] float weight(const kys::Prior& prior) const;
  /// Is it one whose belief is kept?
  [[nodiscard]] bool follows(const kys::Prior& prior) const {
    return start_.mobility(prior.label) != kys::Mobility::kFixed && prior.instance >= 0;
  }
  /// Beliefs that changed since the last call, by instance.
  [[nodiscard]] std::vector<InstanceBelief> take_changed_beliefs();

 private:
  struct Thing {
    std::uint16_t label = kys::kVoidLabel;
    double log_odds = 0;      // of standing still; set by believe_in()
    double p_static = 0.5;    // the same as probability
    kys::Prior belief;        // its motion, as kys::believed() gives it
    double settled = 0;       // where the file puts it
    double timestamp = 0;     // of log_odds
    double first_seen = 0;    // s
    double moving_since = 0;  // s, when p_static fell below kSurelyMoving; meaningful below it
    bool changed = true;      // since take_changed_beliefs
    std::optional<Eigen::Vector3d> velocity;  // m/s in the world; of what moves
    double compared = -1e300;  // s, of the last frame whose matches said how it moves
  };
  using Keypoints = std::map<std::int32_t, std::vector<std::size_t>>;  // by instance
  struct Frame {
    double timestamp = 0;
    std::shared_ptr<const FrameFeatures> features;
    Keypoints keypoints;              // of things, with disparity
    std::vector<std::int32_t> back;   // per feature: its match in the frame before; -1: none
    std::optional<PoseWithout> pose;  // none: exact, it defines the world
  };

  void inherit(double timestamp, const FrameFeatures& features, const Rigid3& T_now_last,
               const Rigid3& T_last_w, std::vector<kys::Prior>& priors);
  void meet(double timestamp, std::span<const kys::Prior> priors);
  void follow(Frame& now, const Rigid3& T_now_last, const Rigid3& T_last_w,
              kys::Statistics& statistics) const;
  void rename(const Frame& now);
  [[nodiscard]] InstanceState judge_one(std::int32_t instance,
                                        const std::vector<std::size_t>& keypoints, const Frame& now,
                                        const Rigid3& T_c_w, std::span<const Rigid3> past) const;
  [[nodiscard]] const Thing* find(const kys::Prior& prior) const;
  static void believe_in(Thing& thing, double log_odds);
  void learn(const InstanceState& state, const Rigid3& T_c_w);

  StereoCamera camera_;
  ScaleLevels scales_;
  InstanceTrackerOptions options_;
  kys::BeliefStart start_;
  const kys::DistanceModel* model_;
  std::map<std::int32_t, Thing> things_;
  std::unordered_map<std::int32_t, Thing*> by_instance_;  // of things_, found fast
  std::deque<Frame> frames_;                              // latest first
  double last_file_ = -1e300;                             // s
  std::vector<InstanceState> states_;
};

}  // namespace kys_slam
