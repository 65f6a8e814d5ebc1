// SPDX-License-Identifier: BSD-3-Clause
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
  int max_frames = 5;       ///< largest number of frames between the two compared
  double kept_share = 0.6;  ///< share of the matches to the last frame that a longer span must keep
  int max_matches = 60;     ///< largest number of keypoints tracked per instance
  double max_speed = 15;    ///< m/s, of instances of unknown motion
  double max_turn = 0.5;    ///< rad/s
  double max_acceleration = 3;      ///< m/s^2, of instances of known motion
  double search_radius = 3.5;       ///< px at octave 0, around a predicted keypoint
  double max_search = 60;           ///< px, largest radius for instances of unknown motion
  double descriptor_distance = 80;  ///< bits
  double descriptor_ratio = 0.85;   ///< best / second best
  /// share of the image width within which a keypoint of a frame without a prior file takes the
  /// prior of the nearest predicted keypoint
  double inherit_radius = 0.015;
  double memory = 1.5;  ///< s without a prior file after which no priors are inherited
};
/// For check_options().
void describe(kys::OptionList& list, InstanceTrackerOptions& options);

/// State of an instance in one frame.
struct InstanceState {
  std::int32_t instance = -1;
  std::uint16_t label = kys::kVoidLabel;
  double p_static = 1;
  int keypoints = 0;      ///< stereo keypoints on it in this frame; 0: others only
  int matches = 0;        ///< of these, tracked from an earlier frame and used
  double log_ratio = 0;   ///< nats, evidence of this frame; > 0: static
  double span = 0;        ///< s, between the two frames compared; 0: not compared
  InstanceMotion motion;  ///< meaningful when span > 0
};

/// Tracks the instances of the left image and keeps for each the belief that it is static. Two
/// calls per frame: `assign_priors` before tracking gives every keypoint its prior with belief;
/// `judge` after tracking updates the belief from the observations of the frame. Deterministic.
/// Keeps the last `max_frames` frames.
class InstanceTracker {
 public:
  /// \param model must outlive the tracker
  InstanceTracker(const StereoCamera& camera, const ScaleLevels& scales,
                  const InstanceTrackerOptions& options, const kys::InitialBelief& start,
                  const kys::DistanceModel& model);

  // by_instance_ points into records_, whose nodes stay where they are when it is moved.
  InstanceTracker(const InstanceTracker& other);
  InstanceTracker& operator=(const InstanceTracker& other) {
    return *this = InstanceTracker(other);
  }
  InstanceTracker(InstanceTracker&&) = default;
  InstanceTracker& operator=(InstanceTracker&&) = default;
  ~InstanceTracker() = default;

  /// Priors of the keypoints of a frame: those of its file, or without a file those of the nearest
  /// keypoints predicted from the last frame. Belief replaces motion.
  /// \param T_c_w_expected predicted pose of the frame
  /// \param T_last_w present pose, in the map, of the last frame given to `judge`
  [[nodiscard]] std::vector<kys::Prior> assign_priors(double timestamp,
                                                      const FrameFeatures& features,
                                                      const Rigid3& T_c_w_expected,
                                                      const Rigid3& T_last_w);

  /// Updates the beliefs from the last frame given to `assign_priors`, after tracking. A frame of
  /// the same time as the last one shows its image again: it says nothing, and is not kept.
  /// \param features with the priors `assign_priors` gave
  /// \param segments of the left image; an instance that is known has a state without keypoints too
  /// \param terms landmarks used for its pose; none: the pose is exact
  /// \param past present T_c_w, in the map, of the frames judged before, latest first; at least
  /// frames_kept() of them
  /// \return states by instance
  const std::vector<InstanceState>& judge(double timestamp,
                                          std::shared_ptr<const FrameFeatures> features,
                                          std::span<const kys::Prior> segments, const Rigid3& T_c_w,
                                          std::span<const PoseTerm> terms,
                                          std::span<const Rigid3> past,
                                          kys::Statistics& statistics);
  /// Call it for a lost frame: the next frame is not compared with earlier ones. Beliefs stay.
  void forget_frames() { frames_.clear(); }
  /// Call it when the world has turned, as by a loop: velocities are those of the world.
  void turn_world(const Eigen::Quaterniond& R_new_old);
  /// Call it in a new world: the velocities of its instances are unknown.
  void forget_velocities();
  [[nodiscard]] std::size_t frames_kept() const { return frames_.size(); }

  /// Probability of being static, 0..1; 1 for an instance that is not tracked.
  [[nodiscard]] double p_static(std::int32_t instance) const;
  /// Log-odds of being static, nats; 0 for an instance that is not tracked.
  [[nodiscard]] double log_odds(std::int32_t instance) const;
  /// The prior of a landmark or keypoint with the present belief; priors of stuff are not changed.
  [[nodiscard]] kys::Prior with_belief(const kys::Prior& prior) const;
  /// Weight of an observation from this belief, 0..1.
  [[nodiscard]] float weight(const kys::Prior& prior) const;
  /// Whether the prior is of an instance with a belief.
  [[nodiscard]] bool follows(const kys::Prior& prior) const { return has_belief(prior, start_); }
  /// m/s in the world; nothing for what is not known to move.
  [[nodiscard]] std::optional<Eigen::Vector3d> velocity(const kys::Prior& prior) const {
    const InstanceRecord* record = find(prior);
    return record != nullptr ? record->velocity : std::nullopt;
  }
  /// Beliefs that changed since the last call, by instance.
  [[nodiscard]] std::vector<InstanceBelief> take_changed_beliefs();

 private:
  struct InstanceRecord {
    std::uint16_t label = kys::kVoidLabel;
    double log_odds = 0;                      // of being static; set by set_log_odds()
    double p_static = 0.5;                    // the same as probability
    kys::Prior belief;                        // its motion, from kys::with_belief()
    double file_log_odds = 0;                 // log-odds given by the last file
    double timestamp = 0;                     // of log_odds
    double first_seen = 0;                    // s
    double moving_since = 0;                  // s, when p_static fell below kSurelyMoving
    bool changed = false;                     // since take_changed_beliefs; it is in changed_
    std::optional<Eigen::Vector3d> velocity;  // m/s in the world; if it moves
    double compared = -1e300;                 // s, of the last frame with enough matches to test it
  };
  using Keypoints = std::map<std::int32_t, std::vector<std::size_t>>;  // by instance
  struct Frame {
    double timestamp = 0;
    std::shared_ptr<const FrameFeatures> features;
    Keypoints keypoints;              // with disparity, of every instance in the image
    std::vector<std::int32_t> back;   // per feature: its match in the frame before; -1: none
    std::optional<PoseWithout> pose;  // empty: exact, the pose defines the world
  };

  void inherit(double timestamp, const FrameFeatures& features, const Rigid3& T_now_last,
               const Rigid3& T_last_w, std::vector<kys::Prior>& priors);
  void start_beliefs(double timestamp, std::span<const kys::Prior> priors);
  void follow(Frame& now, const Rigid3& T_now_last, const Rigid3& T_last_w,
              kys::Statistics& statistics) const;
  void transfer_beliefs(const Frame& now);
  [[nodiscard]] InstanceState state_of(std::int32_t instance,
                                       const std::vector<std::size_t>& keypoints) const;
  [[nodiscard]] InstanceState test_motion(std::int32_t instance,
                                          const std::vector<std::size_t>& keypoints,
                                          const Frame& now, const Rigid3& T_c_w,
                                          std::span<const Rigid3> past) const;
  [[nodiscard]] const InstanceRecord* find(const kys::Prior& prior) const;
  static void set_log_odds(InstanceRecord& record, double log_odds);
  void update_belief(const InstanceState& state, const Rigid3& T_c_w);

  StereoCamera camera_;
  ScaleLevels scales_;
  InstanceTrackerOptions options_;
  kys::InitialBelief start_;
  const kys::DistanceModel* model_;
  std::map<std::int32_t, InstanceRecord> records_;
  std::unordered_map<std::int32_t, InstanceRecord*> by_instance_;  // index of records_
  std::vector<std::int32_t> changed_;                              // instances, each once
  std::deque<Frame> frames_;                                       // latest first
  double last_file_ = -1e300;                                      // s
  std::vector<InstanceState> states_;
};

}  // namespace kys_slam
