// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/path.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace kys_slam::simulator {
namespace {

constexpr double kStep = 0.05;  // m
constexpr double kTick = 0.01;  // s

double wrap(double a) {
  return std::remainder(a, 2 * std::numbers::pi);
}

// Curvature profile of a turn by `angle`: up, level, down, each a third of the length.
struct Turn {
  double angle;
  double length;
  double peak;
  Turn(double a, double radius) : angle(a) {
    peak = (a > 0 ? 1 : -1) / radius;
    length = std::abs(a) * radius * 1.5;  // mean curvature is 2/3 of the peak
  }
  [[nodiscard]] double curvature(double s) const {
    const double third = length / 3;
    if (s <= 0 || s >= length) return 0;
    return peak * std::min({1.0, s / third, (length - s) / third});
  }
};

}  // namespace

double smooth_step(double a, double b, double x) {
  const double k = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return k * k * (3 - 2 * k);
}

Path::Path(const std::vector<Vec2>& corners, double radius) {
  std::vector<double> headings;
  for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
    const Vec2 d = corners[i + 1] - corners[i];
    headings.push_back(std::atan2(d.y(), d.x()));
  }
  std::vector<Turn> turns;
  std::vector<double> tangents(1, 0.0);
  for (std::size_t i = 0; i + 1 < headings.size(); ++i) {
    const Turn turn(wrap(headings[i + 1] - headings[i]), radius);
    double h = 0;
    double y = 0;
    const int steps = 4000;
    const double ds = turn.length / steps;
    for (int k = 0; k < steps; ++k) {
      h += turn.curvature((k + 0.5) * ds) * ds / 2;
      y += std::sin(h) * ds;
      h += turn.curvature((k + 0.5) * ds) * ds / 2;
    }
    turns.push_back(turn);
    tangents.push_back(y / std::sin(turn.angle));
  }
  tangents.push_back(0);
  // Arc length at which each turn begins.
  std::vector<double> begins;
  double s = 0;
  for (std::size_t i = 0; i < headings.size(); ++i) {
    s += (corners[i + 1] - corners[i]).norm() - tangents[i] - tangents[i + 1];
    if (i < turns.size()) {
      begins.push_back(s);
      s += turns[i].length;
    }
  }
  length_ = s;
  Vec2 p = corners.front();
  double h = headings.front();
  const int count = static_cast<int>(length_ / kStep) + 2;
  constexpr int kSub = 10;
  for (int i = 0; i < count; ++i) {
    samples_.push_back({p, h});
    for (int k = 0; k < kSub; ++k) {
      const double x = (i + (k + 0.5) / kSub) * kStep;
      double c = 0;
      for (std::size_t j = 0; j < turns.size(); ++j) c += turns[j].curvature(x - begins[j]);
      h += c * kStep / kSub / 2;
      p += Vec2(std::cos(h), std::sin(h)) * (kStep / kSub);
      h += c * kStep / kSub / 2;
    }
  }
}

Path::Sample Path::at(double s) const {
  const double last = static_cast<double>(samples_.size() - 1) * kStep;
  if (s <= 0 || s >= last) {
    const Sample& end = s <= 0 ? samples_.front() : samples_.back();
    const double rest = s <= 0 ? s : s - last;
    return {end.p + rest * Vec2(std::cos(end.heading), std::sin(end.heading)), end.heading};
  }
  const double k = s / kStep;
  const auto i = std::min(static_cast<std::size_t>(k), samples_.size() - 2);
  const double f = k - static_cast<double>(i);
  const Sample& a = samples_[i];
  const Sample& b = samples_[i + 1];
  return {a.p * (1 - f) + b.p * f, a.heading * (1 - f) + b.heading * f};
}

Vec2 Path::position(double s, double offset) const {
  const Sample a = at(s);
  return a.p + offset * Vec2(-std::sin(a.heading), std::cos(a.heading));
}

double Path::heading(double s) const {
  return at(s).heading;
}

double Path::curvature(double s) const {
  return (at(s + 0.1).heading - at(s - 0.1).heading) / 0.2;
}

Drive::Drive(double start, double duration, const std::function<double(double, double)>& speed) {
  double s = start;
  const int ticks = static_cast<int>(duration / kTick) + 2;
  for (int i = 0; i < ticks; ++i) {
    s_.push_back(s);
    s += speed(s, i * kTick) * kTick;
  }
}

double Drive::distance(double t) const {
  const double k = std::min(t / kTick, static_cast<double>(s_.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(std::max(k, 0.0)), s_.size() - 2);
  const double f = k - static_cast<double>(i);
  return s_[i] * (1 - f) + s_[i + 1] * f;
}

Eigen::Matrix3d vehicle_from_camera() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return R;
}

Rigid3 car_camera(const Path& path, double s, double t, double height) {
  const Vec2 p = path.position(s);
  const double heave = 0.012 * std::sin(2.1 * t) + 0.008 * std::sin(5.3 * t + 0.7);
  const double pitch = 0.0045 * std::sin(1.7 * t + 0.3) + 0.0025 * std::sin(6.1 * t);
  const double roll = 0.004 * std::sin(1.3 * t + 1.1) - 0.12 * path.curvature(s);
  const Eigen::Quaterniond q = Eigen::AngleAxisd(path.heading(s), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()) *
                               Eigen::Quaterniond(vehicle_from_camera());
  return {q, Eigen::Vector3d(p.x(), p.y(), height + heave)};
}

}  // namespace kys_slam::simulator
