#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>

#include <Eigen/Core>
#include <map>
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

/// An object as it really is in one frame.
struct TrueObject {
  int frame = 0;
  int object = 0;
  std::string kind;
  bool moving = false;
  int pixels = -1;                                 ///< visible ones; -1: unknown
  Rigid3 T_g_o;                                    ///< origin in the middle of the box, x forward
  Eigen::Vector3d half = Eigen::Vector3d::Zero();  ///< m, half of the box's sizes
};

/// Where the left camera was.
struct FramePoses {
  double timestamp = 0;  ///< s
  Rigid3 T_w_c;          ///< as estimated
  Rigid3 T_g_c;          ///< in truth
};

enum class RelativeTo {
  kCamera,  ///< what the camera sees: its own error is left out
  kStart,   ///< both expressed in the frame of the first frame's camera
};

struct ObjectEvaluationOptions {
  RelativeTo relative_to = RelativeTo::kCamera;
  double max_range = 25;   ///< m, from the true camera to the middle of the box
  int min_keypoints = 30;  ///< of rows that errors are taken of
  int min_pixels = 2000;  ///< of the object, where they are known, in frames that count as its life
  double max_distance = 2;  ///< m, from an estimate to the box it is assigned to
  int min_life = 5;         ///< frames; shorter lives do not count
};
/// For check_options().
void describe(kys::OptionList& list, ObjectEvaluationOptions& options);

/// Of one estimate that was assigned to an object.
struct ObjectError {
  int frame = 0, instance = 0, object = 0, keypoints = 0;
  bool counts = false;    ///< moves, near enough, enough keypoints
  double range = 0;       ///< m
  double position = 0;    ///< m, from the point of the box that the estimate belongs to
  double outside = 0;     ///< m, of that point outside of the box; part of `position`
  double speed = 0;       ///< m/s, estimated less true
  double velocity = 0;    ///< m/s, length of the difference
  double heading = 0;     ///< degrees between the velocities, 0..180; NaN below 1 m/s
  double deviations = 0;  ///< `velocity` over sigma_v
};

/// How long an object was followed.
struct ObjectLife {
  int object = 0;
  std::string kind;
  int frames = 0;    ///< in which it moves, is near enough and visible
  int followed = 0;  ///< of these, under the identity that has most of them
  int reported = 0;  ///< of these, under any identity
  int identities = 0;
};

struct ObjectEvaluation {
  std::vector<ObjectError> errors;  ///< of all assigned estimates
  std::vector<ObjectLife> lives;    ///< by object
  int estimates = 0;
  int unassigned = 0;  ///< estimates where no object is
  int standing = 0;    ///< estimates on objects that stand
};

/// Assigns estimates to objects and compares them.
///
/// Like with like: an estimate is told of a point that stays on the object, but not which. For
/// every identity on an object it is taken to be the median of the estimates in the object's frame,
/// moved into the box if it is outside; the estimate is compared with where that point really is,
/// its velocity with that point's (central differences of the true poses). Estimates are assigned
/// frame by frame to the nearest box; who was assigned before stays so while it is near enough (as
/// in CLEAR MOT).
ObjectEvaluation evaluate_objects(const std::vector<EstimatedObject>& estimates,
                                  const std::vector<TrueObject>& truth,
                                  const std::map<int, FramePoses>& frames,
                                  const ObjectEvaluationOptions& options);

/// m, from a point to a box about the origin; 0 inside.
double distance_to_box(const Eigen::Vector3d& p, const Eigen::Vector3d& half);

}  // namespace kys_slam
