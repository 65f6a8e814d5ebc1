// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/drive_path.h"

#include <algorithm>
#include <cmath>

namespace kys_slam::simulator {
namespace {

constexpr double kStep = 1;         // m between two samples
constexpr int kSmooth = 2;          // samples to either side that a sample is smoothed with
constexpr double kTimeSigma = 0.3;  // s, of the smoothing of the path length over time

Rigid3 between(const Rigid3& a, const Rigid3& b, double t) {
  return {a.rotation.slerp(t, b.rotation), (1 - t) * a.t() + t * b.t()};
}

// Poses at equal steps of path length; jitter of a static camera is left out.
std::vector<Rigid3> resample(const std::vector<TimedPose>& poses, double& length) {
  std::vector<Rigid3> samples{poses.front().T_w_c};
  length = 0;
  double to_next = kStep;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const Rigid3& a = poses[i - 1].T_w_c;
    const Rigid3& b = poses[i].T_w_c;
    const double d = (b.t() - a.t()).norm();
    length += d;
    double done = 0;
    while (d - done >= to_next) {
      done += to_next;
      samples.push_back(between(a, b, done / d));
      to_next = kStep;
    }
    to_next -= d - done;
  }
  return samples;
}

std::vector<Rigid3> smooth(const std::vector<Rigid3>& samples) {
  std::vector<Rigid3> out;
  const auto n = static_cast<int>(samples.size());
  for (int i = 0; i < n; ++i) {
    const int reach = std::min({kSmooth, i, n - 1 - i});
    const Eigen::Vector4d middle = samples[static_cast<std::size_t>(i)].rotation.coeffs();
    Eigen::Vector4d q = Eigen::Vector4d::Zero();
    Eigen::Vector3d t = Eigen::Vector3d::Zero();
    for (int k = i - reach; k <= i + reach; ++k) {
      const Rigid3& T = samples[static_cast<std::size_t>(k)];
      q += T.rotation.coeffs().dot(middle) < 0 ? -T.rotation.coeffs() : T.rotation.coeffs();
      t += T.t();
    }
    out.emplace_back(Eigen::Quaterniond(Eigen::Vector4d(q.normalized())), t / (2 * reach + 1));
  }
  return out;
}

}  // namespace

DrivePath::DrivePath(const std::vector<TimedPose>& poses) {
  samples_ = smooth(resample(poses, length_));
  std::vector<double> path_lengths{0};
  for (std::size_t i = 0; i < poses.size(); ++i) {
    times_.push_back(poses[i].timestamp);
    if (i > 0)
      path_lengths.push_back(path_lengths.back() +
                             (poses[i].T_w_c.t() - poses[i - 1].T_w_c.t()).norm());
  }
  path_lengths_ = path_lengths;
  const auto n = static_cast<std::ptrdiff_t>(path_lengths.size());
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    // Odd around the ends, so that they stay where they are.
    double sum = 0, weights = 0;
    for (std::ptrdiff_t k = 0; i - k >= 0 && i + k < n && k <= 40; ++k) {
      const auto a = static_cast<std::size_t>(i - k);
      const auto b = static_cast<std::size_t>(i + k);
      const double dt = 0.5 * (times_[b] - times_[a]) / kTimeSigma;
      if (dt > 3) break;
      const double w = std::exp(-0.5 * dt * dt);
      sum += w * (path_lengths[a] + path_lengths[b]) / 2;
      weights += w;
    }
    path_lengths_[static_cast<std::size_t>(i)] = sum / weights;
  }
}

Rigid3 DrivePath::at(double s) const {
  const double last = kStep * static_cast<double>(samples_.size() - 1);
  if (s <= 0 || s >= last) {
    const Rigid3& end = s <= 0 ? samples_.front() : samples_.back();
    const double ahead = s <= 0 ? s : s - last;
    return end * Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, ahead));
  }
  const auto i = static_cast<std::size_t>(s / kStep);
  return between(samples_[i], samples_[std::min(i + 1, samples_.size() - 1)],
                 s / kStep - static_cast<double>(i));
}

Rigid3 DrivePath::beside(double s, const Eigen::Vector3d& t, double yaw) const {
  return at(s) * Rigid3(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY())), t);
}

double DrivePath::path_length_at(double time) const {
  const std::size_t n = times_.size();
  if (n == 1) return 0;
  const auto after = std::upper_bound(times_.begin(), times_.end(), time) - times_.begin();
  const auto i = static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(after, 1, static_cast<std::ptrdiff_t>(n) - 1));
  const double t = (time - times_[i - 1]) / (times_[i] - times_[i - 1]);
  return path_lengths_[i - 1] + t * (path_lengths_[i] - path_lengths_[i - 1]);
}

double DrivePath::speed_at(double time) const {
  const double a = std::max(time - 0.5, first_time());
  const double b = std::min(time + 0.5, last_time());
  return b > a ? (path_length_at(b) - path_length_at(a)) / (b - a) : 0;
}

double DrivePath::turn_between(double s0, double s1) const {
  const Eigen::Vector3d a = at(s0).rotation * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d b = at(s1).rotation * Eigen::Vector3d::UnitZ();
  return std::acos(std::clamp(a.dot(b), -1.0, 1.0));
}

}  // namespace kys_slam::simulator
