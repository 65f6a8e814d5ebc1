// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <memory>
#include <span>

#include "map/id_table.h"
#include "map/replica.h"
#include "matching/landmark_patch.h"

namespace kys_slam {

/// Image patches of landmarks, owned by the tracker: keyframes enter the map with aligned
/// keypoints. The patch of a landmark is from the first keyframe with an image that observes it.
/// Its keypoint there defines the position of the landmark on the surface.
class LandmarkPatches {
 public:
  LandmarkPatches(const StereoCamera& camera, const ScaleLevels& scales)
      : camera_(camera), scales_(scales) {}

  /// The features, with keypoints aligned to the patches of their landmarks (align_corner) where
  /// that succeeds. A patch is warped as a surface parallel to its own image.
  /// \param T_c_w pose of the frame, accurate to a few decimetres
  /// \param landmarks  per feature; invalid: none
  /// \param pyramid  of the frame's left image
  [[nodiscard]] std::shared_ptr<const FrameFeatures> align(const Replica& replica,
                                                           const Rigid3& T_c_w,
                                                           std::span<const LandmarkId> landmarks,
                                                           const ImagePyramid& pyramid,
                                                           const FrameFeatures& features) const;

  /// For a new keyframe: the features, with those marked as aligned that define the position of
  /// their landmark, because the landmark is new or has no patch. Features without a landmark are
  /// marked too: the back end makes landmarks of some. Left unmarked they would have a quarter of
  /// the weight; on rendered worlds this gives 1.1 (0.9-1.3) times the ATE.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> with_origins(
      std::span<const LandmarkId> landmarks, const FrameFeatures& features) const;

  /// Stores patches of a keyframe, for landmarks without a patch and for those observed two or more
  /// octaves apart from their patch.
  void keep(KeyFrameId keyframe, std::span<const LandmarkId> landmarks, const ImagePyramid& pyramid,
            const FrameFeatures& features);

  /// Drops the patches of landmarks that a change set erases or replaces.
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
