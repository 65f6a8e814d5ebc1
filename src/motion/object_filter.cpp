// SPDX-License-Identifier: BSD-3-Clause
#include "motion/object_filter.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace kys_slam::objects {
namespace {

constexpr int kRobustRounds = 10;
constexpr double kQuarterWeight =
    9;                        // chi-square at which an observation has a quarter of its weight
constexpr double kFar = 100;  // m, standard deviation of a place before it is seen

Covariance transition(double dt) {
  Covariance F = Covariance::Identity();
  F.topRightCorner<3, 3>().diagonal().setConstant(dt);
  return F;
}

/// `value` observes the position (offset 0) or the velocity (offset 3).
void take_in(Gaussian& state, int offset, const Eigen::Vector3d& value, const Eigen::Matrix3d& R) {
  const Eigen::Matrix<double, 6, 3> PHt = state.covariance.middleCols<3>(offset);
  const Eigen::Matrix3d S = PHt.middleRows<3>(offset) + R;
  const Eigen::Matrix<double, 6, 3> K = S.ldlt().solve(PHt.transpose()).transpose();
  state.mean += K * (value - state.mean.segment<3>(offset));
  const Covariance P = state.covariance - K * PHt.transpose();
  state.covariance = 0.5 * (P + P.transpose());
}

/// Filters a track forward, then smooths it backward (Rauch, Tung, Striebel). The state after each
/// observation, in their order.
std::vector<Gaussian> smooth(const TrackData& data, const ObjectTrackOptions& options) {
  const std::size_t count = data.times.size();
  const auto time = [&](std::size_t i) { return data.times[i]; };
  const auto& places = data.places;
  std::vector<Gaussian> predicted(count);
  std::vector<Gaussian> filtered(count);
  predicted[0].mean.head<3>() = (*std::find_if(places.begin(), places.end(), [](const auto& p) {
                                  return p.has_value();
                                }))->value;
  predicted[0].covariance.diagonal().head<3>().setConstant(kFar * kFar);
  predicted[0].covariance.diagonal().tail<3>().setConstant(options.start_speed *
                                                           options.start_speed);
  for (std::size_t i = 0; i < count; ++i) {
    if (i > 0) {
      predicted[i] = predict(filtered[i - 1], time(i) - time(i - 1), options.acceleration_density);
    }
    filtered[i] = predicted[i];
    if (places[i]) observe_position(filtered[i], places[i]->value, places[i]->covariance);
    for (const Observed& v : data.velocities[i])
      observe_velocity(filtered[i], v.value, v.covariance);
  }
  std::vector<Gaussian> smoothed = filtered;
  for (std::size_t i = count - 1; i-- > 0;) {
    const Covariance F = transition(time(i + 1) - time(i));
    const Covariance G =
        predicted[i + 1].covariance.ldlt().solve(F * filtered[i].covariance).transpose();
    smoothed[i].mean += G * (smoothed[i + 1].mean - predicted[i + 1].mean);
    smoothed[i].covariance +=
        G * (smoothed[i + 1].covariance - predicted[i + 1].covariance) * G.transpose();
  }
  return smoothed;
}

}  // namespace

/// Vehicles keep their velocity for a second and more, and what changes it is unknown: a constant
/// velocity with white acceleration has one parameter, and gives the right growth of uncertainty
/// for any interval between images. White acceleration, integrated exactly.
Gaussian predict(const Gaussian& from, double dt, double density) {
  const Covariance F = transition(dt);
  Gaussian to{F * from.mean, F * from.covariance * F.transpose()};
  to.covariance.topLeftCorner<3, 3>().diagonal().array() += density * dt * dt * dt / 3;
  to.covariance.topRightCorner<3, 3>().diagonal().array() += density * dt * dt / 2;
  to.covariance.bottomLeftCorner<3, 3>().diagonal().array() += density * dt * dt / 2;
  to.covariance.bottomRightCorner<3, 3>().diagonal().array() += density * dt;
  return to;
}

void observe_position(Gaussian& state, const Eigen::Vector3d& value, const Eigen::Matrix3d& R) {
  take_in(state, 0, value, R);
}

void observe_velocity(Gaussian& state, const Eigen::Vector3d& value, const Eigen::Matrix3d& R) {
  take_in(state, 3, value, R);
}

Observed world_place(const ObjectFrame& frame, const ObservedPlace& seen,
                     const ObjectTrackOptions& options) {
  const Eigen::Matrix3d R = frame.T_w_c->R();
  Eigen::Matrix3d covariance = R * seen.covariance * R.transpose();
  covariance.diagonal().array() += options.surface_sigma * options.surface_sigma;
  return {*frame.T_w_c * seen.centre_c, covariance};
}

Observed world_velocity(const ObjectFrame& frame, const ObservedVelocity& seen,
                        const ObjectTrackOptions& options) {
  const Eigen::Matrix3d R = frame.T_w_c->R();
  Eigen::Matrix3d covariance = R * seen.covariance * R.transpose();
  covariance.diagonal().array() += options.speed_sigma * options.speed_sigma;
  return {R * seen.velocity_c, covariance};
}

std::vector<Gaussian> smooth_robustly(const TrackData& data, const ObjectTrackOptions& options) {
  std::vector<Gaussian> states = smooth(data, options);
  for (int round = 0; round < kRobustRounds; ++round) {
    TrackData weighted = data;
    const auto weigh = [](Observed& seen, const Eigen::Vector3d& value) {
      const Eigen::Vector3d away = seen.value - value;
      const double chi2 = away.dot(seen.covariance.ldlt().solve(away));
      const double less = 1 + chi2 / kQuarterWeight;
      seen.covariance *= less * less;
    };
    for (std::size_t i = 0; i < states.size(); ++i) {
      if (weighted.places[i]) weigh(*weighted.places[i], states[i].mean.head<3>());
      for (Observed& velocity : weighted.velocities[i]) weigh(velocity, states[i].mean.tail<3>());
    }
    states = smooth(weighted, options);
  }
  return states;
}

}  // namespace kys_slam::objects
