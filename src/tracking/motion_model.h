// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>

#include <cstdint>
#include <optional>

#include "optimization/pose_consensus.h"
#include "tracking/image_clock.h"

namespace kys_slam {

struct MotionModelOptions {
  double acceleration = 3;       ///< m/s^2, standard deviation about constant velocity; 0: no prior
  double turn_acceleration = 3;  ///< rad/s^2, the same for rotation
  double impossible = 15;        ///< m/s^2, of the camera; no vehicle brakes with 10
  double longest = 0.5;          ///< s without a pose for which poses are predicted
  double longest_check = 1;      ///< s without a pose for which impossible motions are detected
  double oldest = 2;             ///< s, age of a velocity that is used at the start of a sub-map
  double max_steps = 3;          ///< most steps that widen the search around an expected pixel
};
/// For check_options().
void describe(kys::OptionList& list, MotionModelOptions& options);

/// Constant velocity since the last frame with a pose, and the time at which images were taken.
/// It knows nothing of landmarks: it says where the camera should be and which motions are
/// impossible.
class MotionModel {
 public:
  explicit MotionModel(const MotionModelOptions& options) : options_(options) {}

  /// How a frame with a pose follows the one before.
  enum class Link : std::uint8_t {
    kTracked,      ///< from it: their motion is a velocity
    kRelocalised,  ///< the pose before may be wrong, or of another sub-map
    kStarted,      ///< in a new world, in which the velocity of the last two frames goes on
  };

  /// Time (s) at which the image of a frame was taken. A repeated image shows what the camera
  /// saw before: the next one shows what it has done since. A camera that gives the same one for
  /// longer stands still. No image is taken before one that was there earlier.
  double time_of(std::int64_t index, double timestamp, bool repeated);

  /// Adds a frame with a pose.
  void add(std::int64_t index, double taken, const Rigid3& T_c_w, Link link);
  /// The last frame has another pose, since the map has moved.
  void move_last(const Rigid3& T_c_w) { last_->T_c_w = T_c_w; }
  void forget_velocity() { velocity_.reset(); }

  /// Pose of an image taken at a time (s); none without a velocity, or when the last frame with a
  /// pose is too long ago.
  [[nodiscard]] std::optional<ExpectedPose> expected(double taken) const {
    return expected(taken, options_.longest);
  }
  /// The expected pose as a prior; none when the model has no standard deviations.
  [[nodiscard]] std::optional<PosePrior> prior(double taken) const;
  /// Whether a pose is within `acceleration` (m/s^2) of the expected one; false when none is.
  [[nodiscard]] bool is_near(const Rigid3& T_c_w, double taken, double acceleration) const;
  /// Whether a pose needs an impossible acceleration. A time stamp may be wrong by up to one frame:
  /// tolerated are `steps` times the last step.
  [[nodiscard]] bool is_impossible(const Rigid3& T_c_w, double taken, double steps = 0) const;
  /// Steps of the camera since the last frame with a pose, by which a search is widened: 1 to
  /// `max_steps`. Call it when a pose is expected.
  [[nodiscard]] float steps_since(std::int64_t index, double taken) const;
  [[nodiscard]] const MotionModelOptions& options() const { return options_; }

 private:
  struct Last {
    std::int64_t index = 0;
    double taken = 0;  // s
    Rigid3 T_c_w;
  };
  struct Velocity {
    Rigid3 T_c_last;
    double interval = 0;  // s
    double taken = 0;     // s, of the later frame
  };

  [[nodiscard]] std::optional<ExpectedPose> expected(double taken, double longest) const;

  MotionModelOptions options_;
  ImageClock clock_;
  std::optional<Last> last_;          // last frame with a pose
  std::optional<Velocity> velocity_;  // of the last two tracked frames, perhaps of another sub-map
};

}  // namespace kys_slam
