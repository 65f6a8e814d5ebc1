#pragma once

#include "map/change_set.h"
#include "map/id_table.h"

namespace kys_slam {

/// The tracker's copy of the map: only what tracking reads. Changes when a change set is applied at
/// a frame boundary, and when the tracker itself makes a keyframe.
class Replica {
 public:
  [[nodiscard]] const IdTable<LandmarkId, LandmarkView>& landmarks() const { return landmarks_; }
  [[nodiscard]] const IdTable<KeyFrameId, KeyFrameView>& keyframes() const { return keyframes_; }

  void apply(ChangeSet changes);
  void put(LandmarkId id, LandmarkView view) { landmarks_.put(id, std::move(view)); }
  void put(KeyFrameId id, KeyFrameView view) { keyframes_.put(id, std::move(view)); }
  /// A keyframe that the tracker has made and no change set brings yet. Where a loop is closed
  /// meanwhile, it follows its parent, and landmarks that it is the first to see follow it: else
  /// the tracker would go on beside the corrected map for as long as every frame is a keyframe.
  void put_pending(KeyFrameId id, KeyFrameView view);

  /// Where a landmark that a change set took away went: itself when alive, its successor when it
  /// was replaced, invalid when gone.
  [[nodiscard]] LandmarkId resolve(LandmarkId id) const;

  /// A keyframe that is alive and the motion from it to the given (perhaps culled) one: {k, T_c_k}.
  struct Anchor {
    KeyFrameId keyframe;
    Rigid3 T_c_k;
  };
  [[nodiscard]] Anchor resolve(KeyFrameId id) const;

 private:
  void follow(KeyFrameId pending, const Rigid3& T_c_parent);

  IdTable<LandmarkId, LandmarkView> landmarks_;
  IdTable<KeyFrameId, KeyFrameView> keyframes_;
  IdTable<LandmarkId, LandmarkId> successor_;
  IdTable<KeyFrameId, CulledKeyFrame> culled_;
  std::vector<KeyFrameId> pending_;  // by id
};

}  // namespace kys_slam
