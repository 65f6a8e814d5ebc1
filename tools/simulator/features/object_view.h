// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_file.h>

#include <span>
#include <vector>

#include "simulator/features/boxes.h"
#include "simulator/features/landmarks.h"

namespace kys_slam::simulator {

/// An object in a frame.
struct Presence {
  std::int32_t object;
  Rigid3 T_w_o;
};

/// Objects of a frame that are near enough to be seen: not beyond `reach` (m).
std::vector<Presence> objects_near(const Rigid3& T_w_c, double reach,
                                   std::span<const FeatureObject> objects, std::size_t frame);

/// The boxes of these objects in the two images.
FrameScene scene_of(const StereoCamera& camera, const Rigid3& T_w_c,
                    std::span<const FeatureObject> objects, std::span<const Presence> present);

/// Whether the left camera can see a landmark on an object. The limbs of people leave their box.
bool may_show(const FeatureObject& object, const Presence& presence, const FrameScene& scene);

/// Adds the landmarks on the faces of an object that one of the cameras can see.
void add_sights_on(const FeatureObject& object, const Presence& presence,
                   const StereoCamera& camera, const TimedPose& pose, const LandmarkMap& landmarks,
                   std::vector<Sight>& sights);

/// Marks what stands behind or inside a box, one camera at a time.
void hide(const FrameScene& scene, const StereoCamera& camera, const LandmarkMap& landmarks,
          std::vector<Sight>& sights);

}  // namespace kys_slam::simulator
