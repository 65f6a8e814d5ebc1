// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_file.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "simulator/common/feature_path.h"
#include "simulator/features/boxes.h"

namespace kys_slam::simulator {

class Scenery;

/// Landmarks at random positions along a path, and the features that a stereo camera observes. A
/// first pass over the whole path adds landmarks where a frame has too few, so that a revisited
/// place has the same landmarks.
///
/// A landmark has a position, a cone of viewing directions (12 to 45 degrees around its axis;
/// outside it is occluded or looks different), and a distance at which it is detected at octave 0.
/// Nearer by 1.2^k it is detected at octave k. It is not detected from a larger distance, nor
/// beyond its own number of octaves or the last octave. A smooth viewpoint-dependent shift of the
/// corner by a fraction of a pixel prevents errors from averaging out over frames.
///
/// Traffic adds objects: solid boxes that occlude landmarks behind and inside them. Each has its
/// own landmarks on its faces, with the image density of the static world. The static landmarks are
/// those of the world without traffic.
///
/// With an error of the rig, landmarks are detected where the given cameras see them, and their
/// keypoints are where the true cameras see them.
class FeatureWorld {
 public:
  /// `progress(done)` is called with the share of frames done.
  FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
               const std::function<void(double)>& progress = {});
  ~FeatureWorld();

  [[nodiscard]] std::size_t landmark_count() const;
  /// m, in the world, or in its object's frame.
  [[nodiscard]] Eigen::Vector3d landmark_position(std::int32_t id) const;
  /// The object to which a landmark is fixed; -1: none, it is static.
  [[nodiscard]] std::int32_t object_of(std::int32_t id) const;
  /// The object whose segment contains a landmark: object_of(), or without traffic the parked car
  /// around it; -1: none.
  [[nodiscard]] std::int32_t segment_of(std::int32_t id) const;
  /// Class of a landmark of a labelled world; kys::kVoidLabel: none.
  [[nodiscard]] std::uint16_t label_of(std::int32_t id) const;
  [[nodiscard]] const std::vector<FeatureObject>& objects() const;
  [[nodiscard]] const Scenery& scenery() const;  ///< of a labelled world
  [[nodiscard]] const FeaturePath& path() const;
  /// Where the given cameras see what the true ones see at an observed pixel, within the image. In
  /// the right image that of a point at infinity: nearer ones differ by their disparity times the
  /// relative error of the baseline.
  [[nodiscard]] Eigen::Vector2d ideal_pixel(int camera, double u, double v) const;
  [[nodiscard]] FrameScene scene(std::size_t index) const;
  [[nodiscard]] FeatureTruth truth() const;
  /// The features of a frame; depends on the seed and the frame alone.
  [[nodiscard]] FeatureFrame frame(std::size_t index) const;
  [[nodiscard]] FeatureFileInfo info() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam::simulator
