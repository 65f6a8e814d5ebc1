#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <memory>
#include <span>

#include "map/id_table.h"
#include "map/replica.h"
#include "matching/landmark_patch.h"

namespace kys_slam {

/// What landmarks look like. The tracker owns it and nobody else needs it: keyframes reach the map
/// with their keypoints aligned. The patch of a landmark is that of the first keyframe that sees it
/// with an image; its keypoint there says where on the surface the landmark lies.
class LandmarkPatches {
 public:
  LandmarkPatches(const StereoCamera& camera, const ScaleLevels& scales)
      : camera_(camera), scales_(scales) {}

  /// The features, those whose landmark has a patch aligned with it (align_corner) where that
  /// succeeds. A patch is turned and stretched as a surface parallel to its own image would be.
  /// \param T_c_w    where the frame is, to some decimetres
  /// \param landmarks  per feature; invalid: none
  /// \param pyramid  of the frame's left image
  [[nodiscard]] std::shared_ptr<const FrameFeatures> align(const Replica& replica,
                                                           const Rigid3& T_c_w,
                                                           std::span<const LandmarkId> landmarks,
                                                           const ImagePyramid& pyramid,
                                                           const FrameFeatures& features) const;

  /// For a new keyframe: the features with those counted as aligned that will say where their
  /// landmark lies, since it has no patch yet or will be made of them.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> with_origins(
      std::span<const LandmarkId> landmarks, const FrameFeatures& features) const;

  /// Takes patches from a keyframe, for landmarks that have none and for those that look two
  /// octaves different by now.
  void keep(KeyFrameId keyframe, std::span<const LandmarkId> landmarks, const ImagePyramid& pyramid,
            const FrameFeatures& features);

  /// Lets go of what a change set took away.
  void apply(const ChangeSet& changes);

 private:
  struct Entry {
    KeyFrameId keyframe;
    int octave = 0;
    LandmarkPatch patch;
  };

  StereoCamera camera_;
  ScaleLevels scales_;
  IdTable<LandmarkId, Entry> entries_;
};

}  // namespace kys_slam
