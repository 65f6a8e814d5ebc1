// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>
#include <kys_slam/stereo_camera.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "map/change_set.h"
#include "map/id_table.h"
#include "map/instance_belief.h"
#include "map/keyframe.h"
#include "map/landmark.h"
#include "map/map_contents.h"

namespace kys_slam {

/// Keyframes, landmarks, observations, covisibility graph, spanning tree, loop edges. A value: it
/// owns everything in it. Every change goes through its member functions, which keep observations
/// and covisibility graph consistent and record the changes for the next change set. Not
/// thread-safe: the back end is its only writer and reader.
class Map {
 public:
  Map(const StereoCamera& camera, const ScaleLevels& scales);
  /// A map with these contents. Observations in both directions, covisibility and children are
  /// rebuilt, and check_consistency() is called. Everything counts as changed, so that the next
  /// change set makes a full replica. \throws std::invalid_argument or std::logic_error with the
  /// first error in the contents.
  explicit Map(MapContents contents);

  /// The contents from which Map(contents) rebuilds this map. Features are shared, not copied.
  [[nodiscard]] MapContents contents() const;

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }
  [[nodiscard]] const ScaleLevels& scales() const { return scales_; }
  [[nodiscard]] const IdTable<KeyFrameId, KeyFrame>& keyframes() const { return keyframes_; }
  [[nodiscard]] const IdTable<LandmarkId, Landmark>& landmarks() const { return landmarks_; }
  [[nodiscard]] const KeyFrame& keyframe(KeyFrameId id) const { return keyframes_.at(id); }
  [[nodiscard]] const Landmark& landmark(LandmarkId id) const { return landmarks_.at(id); }
  /// One past the largest keyframe (landmark) id ever used; new ids begin there.
  [[nodiscard]] std::uint32_t keyframe_id_end() const;
  [[nodiscard]] std::uint32_t landmark_id_end() const { return landmarks_.id_end(); }
  [[nodiscard]] bool has(KeyFrameId id) const { return keyframes_.contains(id); }
  [[nodiscard]] bool has(LandmarkId id) const { return landmarks_.contains(id); }

  /// Keyframes that share at least `min_weight` landmarks, largest weight first (ties: lower id),
  /// at most `count`. When there is none, the one with the largest weight.
  [[nodiscard]] std::vector<KeyFrameId> best_covisible(KeyFrameId id, std::size_t count,
                                                       int min_weight = kCovisibilityMin) const;
  /// Number of observations of a landmark; a stereo observation counts twice.
  [[nodiscard]] int observation_weight(LandmarkId id) const;
  /// The landmark itself when present, its successor when it was replaced, invalid when erased.
  [[nodiscard]] LandmarkId resolve(LandmarkId id) const { return landmarks_.resolve(id); }
  /// Parent of a culled keyframe at the time of its culling; invalid for any other.
  [[nodiscard]] KeyFrameId culled_parent(KeyFrameId id) const {
    const CulledKeyFrame* culled = culled_.find(id);
    return culled != nullptr ? culled->parent : KeyFrameId{};
  }
  /// T_c_w of a keyframe, present or culled (then through its parents).
  [[nodiscard]] std::optional<Rigid3> pose(KeyFrameId id) const;
  /// Sub-map of a keyframe, present or culled: the id of its first keyframe. Every sub-map is one
  /// spanning tree with its own world frame. Invalid for an unknown keyframe.
  [[nodiscard]] KeyFrameId submap(KeyFrameId id) const;
  /// Keyframes of a sub-map, by id, without culled ones.
  [[nodiscard]] std::vector<KeyFrameId> submap_keyframes(KeyFrameId submap) const;

  /// The sub-map with most keyframes, of equals the oldest; invalid in an empty map.
  [[nodiscard]] KeyFrameId largest_submap() const;

  /// Adds a keyframe without observations, covisibility, parent or children. Without a sub-map it
  /// starts a new one.
  void add_keyframe(KeyFrame keyframe);
  /// Sets the parent: the older covisible keyframe with the largest weight, or `otherwise` when
  /// there is none. The keyframe joins the sub-map of its parent.
  void connect_to_spanning_tree(KeyFrameId id, KeyFrameId otherwise);
  void add_loop_edge(KeyFrameId a, KeyFrameId b);
  void set_pose(KeyFrameId id, const Rigid3& T_c_w);
  /// Moves keyframes, each with the landmarks that have it as their reference. Updates affected
  /// landmarks as `refresh_geometry`.
  /// \param ids increasing
  /// \param T_c_w new poses, one per id
  void move_keyframes(const std::vector<KeyFrameId>& ids, const std::vector<Rigid3>& T_c_w);
  /// Merges the sub-map of `joint` into that of `onto`: `joint` becomes the root of its tree and a
  /// child of `onto`. Poses and points must be in the common frame already.
  void join_submaps(KeyFrameId joint, KeyFrameId onto);
  /// Sets the correction of what all keyframes measure, present and future ones. The first keyframe
  /// brings its own.
  void set_rig(const RigEstimate& rig);
  [[nodiscard]] const RigCorrection& rig() const { return rig_.correction; }
  [[nodiscard]] const RigEstimate& rig_estimate() const { return rig_; }
  /// After a correction of the scale of the whole map by `factor`: multiplies the translations
  /// T_c_parent of culled keyframes by it, and publishes that the map moved.
  void note_rescaling(double factor);
  /// Product of these factors. A translation measured at another one has to be multiplied by the
  /// quotient.
  [[nodiscard]] double scale() const { return scale_; }
  /// Removes a keyframe and its observations. Its children get a new parent: its own parent or one
  /// of the other children. Returns false for the root of a spanning tree, which is not removed.
  bool cull_keyframe(KeyFrameId id);
  /// Removes the features of a keyframe that observe no landmark, and renumbers the others. Returns
  /// the number removed.
  std::size_t thin_keyframe(KeyFrameId id);

  /// Adds a landmark without observations.
  void add_landmark(Landmark landmark);
  void set_position(LandmarkId id, const Eigen::Vector3d& p_w);
  void add_visible(LandmarkId id, std::uint32_t visible, std::uint32_t found);
  /// Includes the whole landmark in the next change set, changed or not: the tracker assumed that
  /// its new keyframe observes it.
  void publish(LandmarkId id) { touch(id); }
  /// Adds the observation of a landmark by a feature of a keyframe. Returns false, without change,
  /// when the feature already observes a landmark or the keyframe already observes this landmark.
  bool add_observation(LandmarkId landmark, KeyFrameId keyframe, std::uint32_t feature);
  /// Removes an observation. A landmark with a remaining observation weight of 2 or less is erased.
  void remove_observation(LandmarkId landmark, KeyFrameId keyframe);
  void erase_landmark(LandmarkId id);
  /// Merges `from` into `into`: observations are moved from keyframes that do not observe `into`.
  void replace_landmark(LandmarkId from, LandmarkId into);
  /// Updates viewing direction, distance range, representative descriptor and prior of a landmark
  /// from its observations (ORB-SLAM, Sec. III-C).
  void refresh_landmark(LandmarkId id);
  /// Updates viewing direction and distance range only, after poses or points have moved.
  void refresh_geometry(LandmarkId id);
  /// The same for those of many landmarks that are present.
  void refresh_geometry(std::span<const LandmarkId> ids);

  /// From this call on, the motion of a landmark's prior is the belief that it is static
  /// (kys::with_belief), and `weight` uses it.
  void keep_beliefs();
  [[nodiscard]] bool keeps_beliefs() const { return keeps_beliefs_; }
  /// After keep_beliefs(): applies new beliefs to the landmarks on these instances. Erases
  /// landmarks on instances that have moved for longer than `patience` (s). Returns the number
  /// erased.
  int set_beliefs(std::span<const InstanceBelief> beliefs, double patience);
  /// Priors of a keyframe's features that became known later; its landmarks get theirs anew. False:
  /// it is culled or has other features by now.
  bool set_priors(KeyFrameId id, const std::vector<kys::Prior>& priors);
  /// Factor on the information of a landmark's observations, 0..1.
  [[nodiscard]] float weight(const Landmark& landmark) const {
    return keeps_beliefs_ ? kys::p_static(landmark.prior) : 1.0f;
  }

  /// One past the largest instance number of thing classes, without the bit of the right camera.
  /// \param is_thing by label
  [[nodiscard]] std::int32_t instance_end(std::span<const std::uint8_t> is_thing) const;

  /// What changed since the last call.
  [[nodiscard]] ChangeSet take_changes();
  [[nodiscard]] LandmarkView view(LandmarkId id) const;
  [[nodiscard]] KeyFrameView view(KeyFrameId id) const;

  /// Checks every invariant: observations in both directions, covisibility weights, connected
  /// trees, finite numbers. Linear in observations and covisible pairs. \throws std::logic_error
  /// with the first violation.
  void check_consistency() const;

  static constexpr int kCovisibilityMin = 15;  ///< landmarks shared by covisible keyframes
  static constexpr std::size_t kViewNeighbours = 10;

 private:
  void restore_keyframes(std::vector<KeyFrame> keyframes);
  void restore_tree();
  void restore_culled(const std::vector<CulledKeyFrame>& culled);
  void restore_landmarks(std::vector<Landmark> landmarks);
  void restore_covisibility();
  void change_covisibility(KeyFrameId a, KeyFrameId b, int by);
  void touch(KeyFrameId id) {
    if (id.value >= is_dirty_.size()) is_dirty_.resize(std::size_t{id.value} + 1, 0);
    if (is_dirty_[id.value] == 0) dirty_keyframes_.push_back(id);
    is_dirty_[id.value] = 1;
  }
  void touch(LandmarkId id) { dirty_landmarks_.push_back(id); }
  void touch_geometry(LandmarkId id) { moved_landmarks_.push_back(id); }
  void index_instance(LandmarkId id) {
    const std::int32_t instance = landmarks_.at(id).prior.instance;
    if (keeps_beliefs_ && instance >= 0) on_instance_[instance].push_back(id);
  }

  StereoCamera camera_;
  ScaleLevels scales_;
  bool moved_ = false;  // many keyframes together, since the last change set
  RigEstimate rig_;
  double scale_ = 1;
  bool keeps_beliefs_ = false;
  std::map<std::int32_t, InstanceBelief> beliefs_;  // of the instances of this run
  // With beliefs only: every landmark by its instance, and some that had this instance before.
  std::map<std::int32_t, std::vector<LandmarkId>> on_instance_;
  IdTable<KeyFrameId, KeyFrame> keyframes_;
  IdTable<LandmarkId, Landmark> landmarks_;
  IdTable<KeyFrameId, CulledKeyFrame> culled_;

  std::vector<KeyFrameId> dirty_keyframes_;  // each once; some culled since
  std::vector<std::uint8_t> is_dirty_;       // by keyframe id
  std::vector<LandmarkId> dirty_landmarks_;  // with repetitions
  std::vector<LandmarkId> moved_landmarks_;  // the same; some dirty as well
  std::vector<LandmarkId> erased_landmarks_;
  std::vector<std::pair<LandmarkId, LandmarkId>> replaced_;
  std::vector<CulledKeyFrame> newly_culled_;

  // Of refresh_landmark(), kept for their memory.
  std::vector<const kys::Descriptor*> compared_;
  std::vector<std::uint16_t> distances_;
};

}  // namespace kys_slam
