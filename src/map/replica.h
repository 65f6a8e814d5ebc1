// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "map/change_set.h"
#include "map/id_table.h"

namespace kys_slam {

/// The tracker's copy of the map: only the data that tracking reads. It changes when a change set
/// is applied between two frames, and when the tracker creates a keyframe.
class Replica {
 public:
  [[nodiscard]] const IdTable<LandmarkId, LandmarkView>& landmarks() const { return landmarks_; }
  [[nodiscard]] const IdTable<KeyFrameId, KeyFrameView>& keyframes() const { return keyframes_; }

  /// Map::scale of the state it has.
  [[nodiscard]] double scale() const { return scale_; }

  void apply(ChangeSet changes);
  void put(LandmarkId id, LandmarkView view) { landmarks_.put(id, std::move(view)); }
  void put(KeyFrameId id, KeyFrameView view) { keyframes_.put(id, std::move(view)); }
  /// Adds a keyframe of the tracker that no change set contains yet. When a loop is closed before
  /// that, the keyframe moves with its parent, and the landmarks it observes first move with it.
  /// Otherwise the tracker would continue in the uncorrected map as long as every frame is a
  /// keyframe.
  void put_pending(KeyFrameId id, KeyFrameView view);

  /// Records that a pending keyframe observes a landmark, if it is present.
  void add_observer(LandmarkId id, KeyFrameId observer) {
    if (LandmarkView* view = landmarks_.find(id)) view->observers.push_back(observer);
  }

  /// Priors of the features of a keyframe and of the landmarks it observes. A keyframe that has
  /// other features by now stays as it is.
  void set_priors(KeyFrameId id, const std::vector<kys::Prior>& priors);

  /// The landmark itself when present, its successor when it was replaced, invalid when erased.
  [[nodiscard]] LandmarkId resolve(LandmarkId id) const { return landmarks_.resolve(id); }

  /// A present keyframe k and the pose of the given (perhaps culled) keyframe relative to it: {k,
  /// T_c_k}.
  struct Anchor {
    KeyFrameId keyframe;
    Rigid3 T_c_k;
  };
  [[nodiscard]] Anchor resolve(KeyFrameId id) const;

 private:
  void follow(KeyFrameId pending, const Rigid3& T_c_parent);

  IdTable<LandmarkId, LandmarkView> landmarks_;
  IdTable<KeyFrameId, KeyFrameView> keyframes_;
  IdTable<KeyFrameId, CulledKeyFrame> culled_;
  std::vector<KeyFrameId> pending_;  // by id
  double scale_ = 1;
};

}  // namespace kys_slam
