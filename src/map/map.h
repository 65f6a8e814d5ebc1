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

/// Keyframes, landmarks, who sees whom: covisibility graph, spanning tree, loop edges. A value: it
/// owns everything in it, and every change goes through its member functions, which keep
/// observations and the covisibility graph in agreement and note what changed for the next
/// change set. Not thread-safe: the back end is its only writer and reader.
class Map {
 public:
  Map(const StereoCamera& camera, const ScaleLevels& scales);
  /// A map with these contents: who sees whom in both directions, covisibility and children made
  /// anew, check_consistency() passed. Everything in it counts as changed, so that the next change
  /// set makes a full replica.
  /// \throws std::invalid_argument or std::logic_error with the first thing wrong in them.
  explicit Map(MapContents contents);

  /// What Map(contents) makes this map of again. Features are shared, not copied.
  [[nodiscard]] MapContents contents() const;

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }
  [[nodiscard]] const ScaleLevels& scales() const { return scales_; }
  [[nodiscard]] const IdTable<KeyFrameId, KeyFrame>& keyframes() const { return keyframes_; }
  [[nodiscard]] const IdTable<LandmarkId, Landmark>& landmarks() const { return landmarks_; }
  [[nodiscard]] const KeyFrame& keyframe(KeyFrameId id) const { return keyframes_.at(id); }
  [[nodiscard]] const Landmark& landmark(LandmarkId id) const { return landmarks_.at(id); }
  /// One past the largest id any keyframe (landmark) here ever had; new ones begin there.
  [[nodiscard]] std::uint32_t keyframe_id_end() const;
  [[nodiscard]] std::uint32_t landmark_id_end() const { return landmarks_.id_end(); }
  [[nodiscard]] bool has(KeyFrameId id) const { return keyframes_.contains(id); }
  [[nodiscard]] bool has(LandmarkId id) const { return landmarks_.contains(id); }

  /// Neighbours sharing at least `min_weight` landmarks, heaviest first (ties: lower id), at most
  /// `count`. When none is that heavy, the heaviest alone.
  [[nodiscard]] std::vector<KeyFrameId> best_covisible(KeyFrameId id, std::size_t count,
                                                       int min_weight = kCovisibilityMin) const;
  /// Observations of a landmark, a stereo one counting twice.
  [[nodiscard]] int observation_weight(LandmarkId id) const;
  /// Successor of a landmark that was replaced, itself when alive, invalid when gone.
  [[nodiscard]] LandmarkId resolve(LandmarkId id) const;
  /// Parent of a culled keyframe at the time of its culling; invalid for any other.
  [[nodiscard]] KeyFrameId culled_parent(KeyFrameId id) const {
    const CulledKeyFrame* culled = culled_.find(id);
    return culled != nullptr ? culled->parent : KeyFrameId{};
  }
  /// Pose of a keyframe, alive or culled (then through its parents).
  [[nodiscard]] std::optional<Rigid3> pose(KeyFrameId id) const;
  /// Sub-map of a keyframe, alive or culled: the keyframe that began it. Every sub-map is one
  /// spanning tree with a world frame of its own. Invalid for an unknown keyframe.
  [[nodiscard]] KeyFrameId submap(KeyFrameId id) const;
  /// Living keyframes of a sub-map, by id.
  [[nodiscard]] std::vector<KeyFrameId> submap_keyframes(KeyFrameId submap) const;

  /// Adds a keyframe without observations, covisibility, parent or children. Without a sub-map it
  /// begins one.
  void add_keyframe(KeyFrame keyframe);
  /// Makes the heaviest covisible older keyframe the parent (the given one when there is none);
  /// the keyframe joins its sub-map.
  void connect_to_spanning_tree(KeyFrameId id, KeyFrameId otherwise);
  void add_loop_edge(KeyFrameId a, KeyFrameId b);
  void set_pose(KeyFrameId id, const Rigid3& T_c_w);
  /// Moves keyframes, each with the landmarks that have it as their reference. What sees moved
  /// things is brought up to date as by `refresh_geometry`.
  /// \param ids increasing \param T_c_w new poses, as many
  void move_keyframes(const std::vector<KeyFrameId>& ids, const std::vector<Rigid3>& T_c_w);
  /// Makes the sub-map of `joint` part of that of `onto`: its tree is hung up at `joint`, below
  /// `onto`. Poses and points have to be in the common frame already.
  void join_submaps(KeyFrameId joint, KeyFrameId onto);
  /// Disparities of all keyframes, present and future, get this offset added.
  void set_disparity_offset(float offset);
  [[nodiscard]] float disparity_offset() const { return disparity_offset_; }
  /// Stretches the fixed motions by which culled keyframes hang on their parents, when the scale of
  /// the whole map was corrected.
  void scale_culled(double factor);
  /// Removes a keyframe and its observations; its children find a new parent among its own parent
  /// and each other. The root of the spanning tree stays: returns false.
  bool cull_keyframe(KeyFrameId id);
  /// Drops the features of a keyframe that see no landmark; the others are numbered anew. Returns
  /// how many went.
  std::size_t thin_keyframe(KeyFrameId id);

  /// Adds a landmark without observations.
  void add_landmark(Landmark landmark);
  void set_position(LandmarkId id, const Eigen::Vector3d& p_w);
  void add_visible(LandmarkId id, std::uint32_t visible, std::uint32_t found);
  /// The next change set has all of the landmark, changed or not: the tracker took for granted that
  /// its new keyframe sees it.
  void publish(LandmarkId id) { touch(id); }
  /// A keyframe's feature sees a landmark. Both have to be free of such an observation: returns
  /// false otherwise.
  bool add_observation(LandmarkId landmark, KeyFrameId keyframe, std::uint32_t feature);
  /// Takes an observation back; a landmark left with an observation weight of 2 or less is erased.
  void remove_observation(LandmarkId landmark, KeyFrameId keyframe);
  void erase_landmark(LandmarkId id);
  /// Merges `from` into `into`: observations move where `into` has none in that keyframe.
  void replace_landmark(LandmarkId from, LandmarkId into);
  /// Brings viewing direction, distance range, representative descriptor and prior of a landmark
  /// up to date with its observations (ORB-SLAM, Sec. III-C).
  void refresh_landmark(LandmarkId id);
  /// The cheaper part, after poses or points moved: direction and distance range alone.
  void refresh_geometry(LandmarkId id);

  /// From here on the motion of a landmark's prior is the belief in its standing still
  /// (kys::believed), and `weight` follows it.
  void keep_beliefs() { keeps_beliefs_ = true; }
  /// New beliefs reach the landmarks on these things; landmarks on what has moved for longer than
  /// `patience` (s) are erased. Returns how many were.
  int set_beliefs(std::span<const InstanceBelief> beliefs, double patience);
  /// Factor on the information of a landmark's observations, 0..1.
  [[nodiscard]] float weight(const Landmark& landmark) const {
    return keeps_beliefs_ ? kys::p_static(landmark.prior) : 1.0f;
  }

  /// One past the largest instance number of things, that of the camera aside.
  /// \param is_thing by label
  [[nodiscard]] std::int32_t instance_end(std::span<const std::uint8_t> is_thing) const;

  /// What changed since the last call.
  [[nodiscard]] ChangeSet take_changes();
  [[nodiscard]] LandmarkView view(LandmarkId id) const;
  [[nodiscard]] KeyFrameView view(KeyFrameId id) const;

  /// Checks every invariant, in time linear in observations and covisible pairs: observations in
  /// both directions, weights recounted, tree connected, finite numbers. \throws std::logic_error
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

  StereoCamera camera_;
  ScaleLevels scales_;
  bool moved_ = false;          // keyframes as a whole, since the last change set
  float disparity_offset_ = 0;  // px
  bool keeps_beliefs_ = false;
  std::map<std::int32_t, InstanceBelief> beliefs_;  // of this session's things
  IdTable<KeyFrameId, KeyFrame> keyframes_;
  IdTable<LandmarkId, Landmark> landmarks_;
  IdTable<LandmarkId, LandmarkId> successor_;  // of replaced landmarks
  IdTable<KeyFrameId, CulledKeyFrame> culled_;

  std::vector<KeyFrameId> dirty_keyframes_;  // each once; some culled since
  std::vector<std::uint8_t> is_dirty_;       // by keyframe id
  std::vector<LandmarkId> dirty_landmarks_;  // with repetitions
  std::vector<LandmarkId> moved_landmarks_;  // the same; some dirty as well
  std::vector<LandmarkId> erased_landmarks_;
  std::vector<std::pair<LandmarkId, LandmarkId>> replaced_;
  std::vector<CulledKeyFrame> newly_culled_;
};

}  // namespace kys_slam
