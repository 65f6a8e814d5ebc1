// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "priors/fusion/object_classes.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Pixels x0 <= x < x1 of row y.
struct MaskRun {
  std::int32_t y = 0, x0 = 0, x1 = 0;
};

/// Velocity of a thing, by its keypoints.
struct ThingMotion {
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s in the world, axes of the camera
  double sigma = 0;                                    ///< m/s, standard deviation along any axis
};

/// A thing of earlier frames where it is expected in this image.
struct ExpectedThing {
  std::vector<MaskRun> mask;
  std::optional<ThingMotion> motion;  ///< nothing: not known
  int frames = 0;                     ///< in which it was seen
  float disparity = 0;                ///< px, median when it was last seen; 0: not known
};

/// Makes the thing segments of an image objects, with what is known of earlier frames. Networks
/// without instances, or with several classes for the parts of one object, need it.
///
/// Split: a segment that covers two or more things of earlier frames, at their depths, that move
/// differently becomes as many. A pixel goes to the thing whose expected mask is nearest in the
/// image.
///
/// Joined: segments of classes that belong together (ObjectClasses), one beside the other, along
/// whose common border the disparity is continuous; and a small segment of any class that moves
/// which is mostly surrounded by another, as deep. Segments of things known to move differently, or
/// of two that were seen by themselves for several frames, are not joined. The object has the class
/// of most of its pixels, and the number of its largest segment.
///
/// Both count two things as moving differently if their velocities differ by more than
/// `kApartSpeed` and by three standard deviations.
/// \param disparity px, NaN: not known
void make_objects(const ImageOf<float>& disparity, const ObjectClasses& classes,
                  std::span<const ExpectedThing> expected, PanopticMap& panoptic);

/// Whether two things are known to move differently.
bool move_apart(const std::optional<ThingMotion>& a, const std::optional<ThingMotion>& b);

}  // namespace kys_slam
