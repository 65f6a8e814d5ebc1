// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// A row of a run's objects.csv.
struct EstimatedObject {
  int frame = 0;
  int instance = 0;
  std::string kind;  ///< class
  double p_moving = 0;
  int keypoints = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< m, in the frame of the trajectory
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s
  double sigma_v = 0;                                  ///< m/s
};

/// Ground truth of an object in one frame.
struct TrueObject {
  int frame = 0;
  int object = 0;
  std::string kind;
  bool moving = false;
  int pixels = -1;                                 ///< visible ones; -1: unknown
  Rigid3 T_g_o;                                    ///< origin in the centre of the box, x forward
  Eigen::Vector3d half = Eigen::Vector3d::Zero();  ///< m, half of the box's sizes
};

/// Pose of the left camera.
struct FramePoses {
  double timestamp = 0;  ///< s
  Rigid3 T_w_c;          ///< estimate
  Rigid3 T_g_c;          ///< ground truth
};

enum class RelativeTo {
  kCamera,  ///< relative to the camera: the error of the camera pose is excluded
  kStart,   ///< both expressed in the frame of the first frame's camera
};

struct ObjectEvaluationOptions {
  RelativeTo relative_to = RelativeTo::kCamera;
  double max_range = 25;     ///< m, from the true camera to the centre of the box
  int min_keypoints = 30;    ///< of estimates used for errors
  int min_pixels = 2000;     ///< visible pixels, where known, in frames that count as its lifetime
  double max_distance = 2;   ///< m, from an estimate to the box it is assigned to
  int min_life = 5;          ///< frames; shorter lifetimes do not count
  int first_frame = 0;       ///< earlier frames do not count
  int last_frame = 1 << 30;  ///< later frames do not count
};
/// For check_options().
void describe(kys::OptionList& list, ObjectEvaluationOptions& options);

/// Errors of one estimate that was assigned to an object.
struct ObjectError {
  int frame = 0, instance = 0, object = 0, keypoints = 0;
  bool counts = false;    ///< moves, within max_range, at least min_keypoints
  double range = 0;       ///< m
  double position = 0;    ///< m, from the point of the box that the estimate belongs to
  double outside = 0;     ///< m, distance of that point from the box; part of `position`
  double speed = 0;       ///< m/s, estimated minus true
  double velocity = 0;    ///< m/s, length of the difference
  double heading = 0;     ///< degrees between the velocities, 0..180; NaN below 1 m/s
  double deviations = 0;  ///< `velocity` divided by sigma_v
};

/// How long an object was tracked.
struct ObjectLife {
  int object = 0;
  std::string kind;
  int frames = 0;    ///< in which it moves, is within max_range and visible
  int followed = 0;  ///< of these, with its most frequent identity
  int reported = 0;  ///< of these, with any identity
  int identities = 0;
};

/// A frame of an object's lifetime.
struct ObjectLifeFrame {
  int object = 0, frame = 0;
  double range = 0;             ///< m
  std::optional<int> identity;  ///< of its estimate, if there is one
};

struct ObjectEvaluation {
  std::vector<ObjectError> errors;           ///< of all assigned estimates
  std::vector<ObjectLife> lives;             ///< by object
  std::vector<ObjectLifeFrame> life_frames;  ///< of these, by object and frame
  int estimates = 0;                         ///< in the frames that count
  int unassigned = 0;                        ///< estimates without an object
  int standing = 0;                          ///< estimates on static objects
};

/// Assigns estimates to objects and compares them.
///
/// An estimate is that of a point fixed to the object; which point is not known. For every identity
/// on an object the evaluation uses the median of its estimates in the object's frame, moved into
/// the box if outside. The estimate is compared with the true position of that point, its velocity
/// with the true velocity of that point (central differences of the true poses). Estimates are
/// assigned frame by frame to the nearest box; an assignment of the frame before is kept while it
/// is within max_distance (as in CLEAR MOT).
ObjectEvaluation evaluate_objects(const std::vector<EstimatedObject>& estimates,
                                  const std::vector<TrueObject>& truth,
                                  const std::map<int, FramePoses>& frames,
                                  const ObjectEvaluationOptions& options);

/// m, from a point to a box about the origin; 0 inside.
double distance_to_box(const Eigen::Vector3d& p, const Eigen::Vector3d& half);

}  // namespace kys_slam
