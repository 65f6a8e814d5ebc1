// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/motion_model.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {

void describe(kys::OptionList& list, MotionModelOptions& o) {
  list.add("tracking.acceleration", o.acceleration, {0, 1e6}, "m/s^2",
           "standard deviation about constant velocity, a prior of poses with few matches and of "
           "lost frames; 0: no prior");
  list.add("tracking.turn_acceleration", o.turn_acceleration, {1e-3, 1e6}, "rad/s^2",
           "the same for rotation");
  list.add("tracking.impossible_acceleration", o.impossible, {0.1, 1e6}, "m/s^2",
           "a pose that needs more is rejected while another explains the image");
  list.add("tracking.longest_prediction", o.longest, {0, 60}, "s",
           "without a pose after which constant velocity predicts no more");
  list.add("tracking.longest_check", o.longest_check, {0, 60}, "s",
           "without a pose after which any motion is possible");
  list.add("tracking.oldest_velocity", o.oldest, {0, 60}, "s",
           "age of a velocity up to which a new sub-map starts with it");
  list.add("tracking.max_steps", o.max_steps, {1, 100}, "",
           "steps of the camera without a pose by which search radii grow at most");
}

double MotionModel::time_of(std::int64_t index, double timestamp, bool repeated) {
  const double time = clock_.time_of(timestamp);
  if (!last_) return time;
  if (repeated && last_->index + 1 == index) {
    if (time - last_->taken <= options_.longest) return last_->taken;
    if (velocity_) velocity_->T_c_last = Rigid3();
  }
  return std::max(time, last_->taken);
}

void MotionModel::add(std::int64_t index, double taken, const Rigid3& T_c_w, Link link) {
  if (last_ && last_->index + 1 == index && link == Link::kTracked) {
    const double interval = taken - last_->taken;
    if (interval > 0) velocity_ = {T_c_w * last_->T_c_w.inverse(), interval, taken};
  } else if (link != Link::kStarted || options_.acceleration <= 0) {
    velocity_.reset();
  }
  last_ = {index, taken, T_c_w};
}

/// Constant velocity over the time between the images, not over frames: a missing image is a longer
/// step. The uncertainty (`reach`, s^2, times an acceleration) grows with the interval and with the
/// age of the velocity. A step of one period keeps the last motion as it is, without exp and log.
std::optional<ExpectedPose> MotionModel::expected(double taken, double longest) const {
  if (!velocity_ || !last_) return std::nullopt;
  const double interval = taken - last_->taken;
  if (interval > std::max(longest, 1.5 * velocity_->interval)) return std::nullopt;
  const double age = last_->taken - velocity_->taken;
  if (age > options_.oldest) return std::nullopt;
  const double before = velocity_->interval;
  if (interval <= 0) return ExpectedPose{last_->T_c_w, before * (before + age)};
  const Rigid3& step = velocity_->T_c_last;
  const double times = clock_.ratio(interval, before);
  if (times == 1) return ExpectedPose{step * last_->T_c_w, interval * (interval + age)};
  if (options_.acceleration <= 0) return std::nullopt;
  // The velocity is that of the middle of the step before.
  const double reach = interval * ((interval + before) / 2 + age);
  const Rigid3 other(so3_exp(times * so3_log(step.rotation)), times * step.translation);
  return ExpectedPose{other * last_->T_c_w, reach};
}

std::optional<PosePrior> MotionModel::prior(double taken) const {
  const std::optional<ExpectedPose> pose = expected(taken);
  if (!pose || options_.acceleration <= 0) return std::nullopt;
  return PosePrior{pose->T_c_w, options_.acceleration * pose->reach,
                   options_.turn_acceleration * pose->reach};
}

bool MotionModel::is_near(const Rigid3& T_c_w, double taken, double acceleration) const {
  const std::optional<ExpectedPose> pose = expected(taken);
  if (!pose || options_.acceleration <= 0) return false;
  return centre_distance(T_c_w, pose->T_c_w) <= acceleration * pose->reach;
}

/// No vehicle or drone that is meant here accelerates at more than 15 m/s^2; a pose that follows
/// the wrong object often does so in its first frame. `steps` of the last motion are allowed
/// besides, for callers that do not know whether the camera has gone on or stopped.
bool MotionModel::is_impossible(const Rigid3& T_c_w, double taken, double steps) const {
  const std::optional<ExpectedPose> pose = expected(taken, options_.longest_check);
  if (!pose) return false;
  const double away = centre_distance(T_c_w, pose->T_c_w);
  return away > options_.impossible * pose->reach + steps * velocity_->T_c_last.inverse_t().norm();
}

float MotionModel::steps_since(std::int64_t index, double taken) const {
  const double interval = taken - last_->taken;
  const double steps =
      clock_.steps_in(interval).value_or(std::round(interval / velocity_->interval));
  return static_cast<float>(
      std::min(std::max(static_cast<double>(index - last_->index), steps), options_.max_steps));
}

}  // namespace kys_slam
