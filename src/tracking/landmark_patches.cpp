// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/landmark_patches.h"

#include <cstdlib>
#include <vector>

namespace kys_slam {

namespace {

/// Pixels of the current octave per pixel of the patch, both of their own octave, of a surface
/// parallel to the image that the patch was taken from.
/// \param ratio  scale of the patch's octave over that of the current one
Eigen::Matrix2f warp_of(const StereoCamera& camera, const Eigen::Matrix3d& R_c_r,
                        const Eigen::Vector3d& p_c, double depth_r, double ratio) {
  // A step of one pixel along a row of the patch is depth / fx along x there; projecting it
  // differentiates p -> (fx x / z, fy y / z).
  const double x = p_c.x() / p_c.z(), y = p_c.y() / p_c.z();
  const Eigen::Vector2d focal(camera.fx, camera.fy);
  Eigen::Matrix2d warp;
  for (int k = 0; k < 2; ++k) {
    warp(0, k) = focal.x() / focal[k] * (R_c_r(0, k) - x * R_c_r(2, k));
    warp(1, k) = focal.y() / focal[k] * (R_c_r(1, k) - y * R_c_r(2, k));
  }
  return (depth_r / p_c.z() * ratio * warp).cast<float>();
}

}  // namespace

std::shared_ptr<const FrameFeatures> LandmarkPatches::align(const Replica& replica,
                                                            const Rigid3& T_c_w,
                                                            std::span<const LandmarkId> landmarks,
                                                            const ImagePyramid& pyramid,
                                                            const FrameFeatures& features) const {
  std::vector<FrameFeatures::Aligned> aligned;
  KeyFrameId from;  // the keyframe that T_r_w and R_c_r belong to
  Rigid3 T_r_w;
  Eigen::Matrix3d R_c_r = Eigen::Matrix3d::Identity();
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const Entry* entry = entries_.find(landmarks[i]);
    const LandmarkView* landmark = replica.landmarks().find(landmarks[i]);
    if (entry == nullptr || landmark == nullptr) continue;
    if (entry->keyframe != from) {
      from = entry->keyframe;
      const Replica::Anchor anchor = replica.resolve(from);
      T_r_w = anchor.T_c_k * replica.keyframes().at(anchor.keyframe).T_c_w;
      R_c_r = (T_c_w.rotation * T_r_w.rotation.conjugate()).toRotationMatrix();
    }
    const Eigen::Vector3d p_c = T_c_w * landmark->p_w;
    const double depth_r = (T_r_w * landmark->p_w).z();
    if (!(p_c.z() > 0 && depth_r > 0)) continue;
    const Keypoint& k = features.keypoint(i);
    const double ratio = scales_.scale[static_cast<std::size_t>(entry->octave)] /
                         scales_.scale[static_cast<std::size_t>(k.octave)];
    const RigCorrection::Measured m = features.measured(i);
    const auto place = align_corner(entry->patch, warp_of(camera_, R_c_r, p_c, depth_r, ratio),
                                    pyramid, k.octave, m.u, m.v);
    if (place) aligned.push_back({static_cast<std::uint32_t>(i), place->u, place->v});
  }
  return std::make_shared<const FrameFeatures>(features.with_aligned(aligned));
}

std::shared_ptr<const FrameFeatures> LandmarkPatches::with_origins(
    std::span<const LandmarkId> landmarks, const FrameFeatures& features) const {
  std::vector<FrameFeatures::Aligned> origins;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (entries_.contains(landmarks[i])) continue;
    const RigCorrection::Measured m = features.measured(i);
    origins.push_back({static_cast<std::uint32_t>(i), m.u, m.v});
  }
  return std::make_shared<const FrameFeatures>(features.with_aligned(origins));
}

void LandmarkPatches::keep(KeyFrameId keyframe, std::span<const LandmarkId> landmarks,
                           const ImagePyramid& pyramid, const FrameFeatures& features) {
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (!landmarks[i].valid()) continue;
    const int octave = features.keypoint(i).octave;
    if (const Entry* entry = entries_.find(landmarks[i])) {
      if (!features.is_aligned(i) || std::abs(entry->octave - octave) < 2) continue;
    }
    const RigCorrection::Measured m = features.measured(i);
    if (const auto patch = cut_patch(pyramid, octave, m.u, m.v)) {
      entries_.put(landmarks[i], {keyframe, octave, *patch});
    }
  }
}

void LandmarkPatches::apply(const ChangeSet& changes) {
  for (const LandmarkId id : changes.erased_landmarks) entries_.erase(id);
  for (const auto& [from, into] : changes.replaced) entries_.erase(from);
}

}  // namespace kys_slam
