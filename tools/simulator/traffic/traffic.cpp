// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/traffic.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>

#include "simulator/common/coco_classes.h"
#include "simulator/common/rng.h"
#include "simulator/traffic/drive_path.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

constexpr int kBicycle = 2;  // COCO ids the rendered worlds have no use for
constexpr int kSuitcase = 33;
constexpr double kBumper = 1.7;     // m, from the camera to the front of its own car
constexpr double kClearance = 1.1;  // m around the camera that nothing enters
constexpr double kSeen = 90;        // m, farther away nothing needs to exist
constexpr double kBehind = 15;      // m, likewise behind the camera

/// Mean times between two of a kind, s; 0: none.
struct Density {
  double lead_stays, lead_absent;  ///< s, of a vehicle ahead
  double headway;                  ///< s that the vehicle ahead is ahead in time
  double gap;                      ///< m between bumpers at rest
  double large;                    ///< share of trucks and buses
  double oncoming, crossing, overtaking, cycles, walkers;
  double at_stops;  ///< s between vehicles that cross where the camera waits
  double people;    ///< s between people in a room
};

Density density_of(Traffic traffic) {
  switch (traffic) {
    case Traffic::kLight:
      return {25, 60, 1.9, 3.5, 0.2, 25, 150, 200, 60, 20, 4, 20};
    case Traffic::kCity:
      return {70, 20, 1.5, 3.0, 0.3, 7, 45, 90, 40, 5, 2.5, 6};
    case Traffic::kJam:
      return {180, 5, 1.0, 2.2, 0.5, 3, 35, 40, 30, 3, 1.8, 2.5};
    case Traffic::kNone:
      break;
  }
  return {};
}

struct Model {
  int category;
  Vector3d half;  ///< m
};

Model vehicle(Rng& rng, double large) {
  if (!rng.chance(large)) {
    const double k = rng.uniform(0.93, 1.08);
    return {kCar, k * Vector3d(0.9, 0.74, 2.15)};
  }
  const double kind = rng.uniform();
  if (kind < 0.4) return {kTruck, {1.05, 1.25, 2.9}};  // a van
  if (kind < 0.75) return {kTruck, {1.25, 1.75, 4.5}};
  return {kBus, {1.25, 1.5, 5.8}};
}

double smooth_step(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

class TrafficMaker {
 public:
  TrafficMaker(const FeaturePath& path, Traffic density, std::uint64_t seed)
      : path_(path), road_(path.poses), density_(density_of(density)), seed_(seed) {}

  std::vector<FeatureObject> on_road();
  std::vector<FeatureObject> in_room();

 private:
  using PoseAt = std::function<Rigid3(double time)>;

  void add(const Model& model, FeatureObject::Kind kind, double from, double to,
           const PoseAt& pose);
  /// T_w_o of a box that stands on the road.
  [[nodiscard]] Rigid3 on(double s, double lateral, double yaw, const Vector3d& half) const {
    return road_.beside(s, {lateral, path_.ground - half.y(), 0}, yaw);
  }
  void each(std::uint64_t salt, double period, const std::function<void(double, Rng&)>& make) const;
  void leads();
  void lead(double from, double to, Rng& rng);
  [[nodiscard]] std::optional<double> straight_on_from(double from, double to) const;
  void oncoming(double time, Rng& rng);
  void overtaking(double time, Rng& rng);
  void crossing(double time, double s, double speed, Rng& rng);
  void walker(double time, Rng& rng);
  void cycle(double time, Rng& rng);
  void at_stops();
  void waiting(double from, double to, Rng& rng);
  void person_in_room(double time, Rng& rng);
  [[nodiscard]] bool has_lead(double time) const;

  const FeaturePath& path_;
  DrivePath road_;
  Density density_;
  std::uint64_t seed_;
  std::vector<FeatureObject> objects_;
  std::vector<std::pair<double, double>> lead_times_;
};

// The part of a motion that can be seen, up to where the camera would hit it.
void TrafficMaker::add(const Model& model, FeatureObject::Kind kind, double from, double to,
                       const PoseAt& pose) {
  FeatureObject object;
  object.label = coco_label(model.category);
  object.kind = kind;
  object.half_size = model.half.cast<float>();
  std::size_t seen = 0;  // poses up to the last one near enough
  for (std::size_t i = 0; i < path_.poses.size(); ++i) {
    const TimedPose& camera = path_.poses[i];
    if (camera.timestamp < from) continue;
    if (camera.timestamp > to) break;
    const Rigid3 T_w_o = pose(camera.timestamp);
    const Vector3d c_o = T_w_o.inverse() * camera.T_w_c.t();
    const Vector3d o_c = camera.T_w_c.inverse() * T_w_o.t();
    const bool hit = (c_o.cwiseAbs() - model.half).maxCoeff() < kClearance;
    if (hit) break;
    const bool near = o_c.norm() < kSeen && o_c.z() > -kBehind;
    if (!near && object.poses.empty()) continue;
    if (object.poses.empty()) object.first_frame = static_cast<std::int64_t>(i);
    object.poses.push_back(T_w_o);
    if (near) seen = object.poses.size();
  }
  object.poses.resize(seen);
  if (seen > 1) objects_.push_back(std::move(object));
}

// Calls make(time, generator) at random times, `period` apart on average.
void TrafficMaker::each(std::uint64_t salt, double period,
                        const std::function<void(double, Rng&)>& make) const {
  if (period <= 0) return;
  Rng times(hash_of(seed_, 20, salt));
  std::uint64_t number = 0;
  for (double t = road_.first_time();;) {
    t -= period * std::log(1 - times.uniform());
    if (t > road_.last_time()) return;
    Rng own(hash_of(seed_, 21, salt, number++));
    make(t, own);
  }
}

void TrafficMaker::leads() {
  Rng rng(hash_of(seed_, 22));
  const double share = density_.lead_stays / (density_.lead_stays + density_.lead_absent);
  const bool already = rng.chance(share);
  double t = road_.first_time() +
             rng.uniform() * (already ? -0.5 * density_.lead_stays : density_.lead_absent);
  while (t < road_.last_time()) {
    const double stays = density_.lead_stays * rng.uniform(0.5, 1.5);
    lead(t, t + stays, rng);
    t = lead_times_.back().second + density_.lead_absent * rng.uniform(0.4, 1.6);
  }
}

bool TrafficMaker::has_lead(double time) const {
  return std::any_of(lead_times_.begin(), lead_times_.end(), [&](const auto& span) {
    return time >= span.first - 2 && time <= span.second + 2;
  });
}

// Where, between two places, the way begins to turn off.
std::optional<double> TrafficMaker::straight_on_from(double from, double to) const {
  for (double s = from; s < to; s += 2) {
    if (road_.turn_between(s, s + 22) > 0.8) return s;
  }
  return std::nullopt;
}

// A vehicle ahead: where the camera will be after the headway, and a gap more. It comes up from far
// ahead, and goes by drawing away or, where the way turns in its last half minute, straight on.
void TrafficMaker::lead(double from, double to, Rng& rng) {
  const Model model = vehicle(rng, density_.large);
  const double headway = density_.headway * rng.uniform(0.8, 1.25);
  const double rest = kBumper + density_.gap * rng.uniform(0.8, 1.5) + model.half.z();
  const double phase = rng.uniform(0, 2 * std::numbers::pi);
  const double lateral = rng.uniform(-0.25, 0.25);
  // The wobble is one of place: it stands still where the camera does.
  const auto steady = [=, this](double t) {
    const double s = road_.path_length_at(t + headway) + rest;
    return s + 1.2 * std::sin(2 * std::numbers::pi * s / 130 + phase);
  };
  const bool turns_off = rng.chance(0.7);
  const auto turn = straight_on_from(steady(std::max(from + 8, to - 30)), steady(to));
  const double leaves = turn && turns_off ? *turn : std::numeric_limits<double>::infinity();
  const double end = leaves < steady(to) ? to + 10 : to + 12;
  const auto pose = [=, this](double t) {
    // Over a distance, so that it never drives backwards.
    const double away =
        70 * (1 - smooth_step((road_.path_length_at(t) - road_.path_length_at(from)) / 120));
    const double gone = leaves < steady(to) ? 0 : 70 * smooth_step((t - to) / 12);
    const double s = steady(t) + away + gone;
    if (s <= leaves) return on(s, lateral, 0, model.half);
    return on(leaves, lateral, 0, model.half) *
           Rigid3(Eigen::Quaterniond::Identity(), Vector3d(0, 0, s - leaves));
  };
  add(model, FeatureObject::Kind::kRigid, from, end, pose);
  lead_times_.emplace_back(from, to);
}

void TrafficMaker::oncoming(double time, Rng& rng) {
  const Model model = vehicle(rng, 0.7 * density_.large);
  const double speed = rng.uniform(6, 13);
  const double s = road_.path_length_at(time);
  const double lateral = kLeftLane + rng.uniform(-0.3, 0.3);
  add(model, FeatureObject::Kind::kRigid, time - 20, time + 6, [&, this](double t) {
    return on(s - speed * (t - time), lateral, std::numbers::pi, model.half);
  });
}

void TrafficMaker::overtaking(double time, Rng& rng) {
  const Model model = vehicle(rng, 0.1);
  const double faster = rng.uniform(2.5, 5);
  add(model, FeatureObject::Kind::kRigid, time - 5, time + 30, [&, this](double t) {
    const double s = road_.path_length_at(t) + faster * (t - time);
    return on(s, kLeftLane + 0.2, 0, model.half);
  });
}

// Crosses the way at s at that time, from either side.
void TrafficMaker::crossing(double time, double s, double speed, Rng& rng) {
  const Model model = vehicle(rng, density_.large);
  const double side = rng.chance(0.5) ? 1 : -1;
  const double askew = rng.uniform(-0.15, 0.15);
  add(model, FeatureObject::Kind::kRigid, time - 45 / speed, time + 45 / speed,
      [&, this](double t) {
        const Rigid3 T_w_p = on(s, 0, side * std::numbers::pi / 2 + askew, model.half);
        return T_w_p * Rigid3(Eigen::Quaterniond::Identity(), Vector3d(0, 0, speed * (t - time)));
      });
}

void TrafficMaker::walker(double time, Rng& rng) {
  const Vector3d half(0.28, 0.86, 0.2);
  const bool back = rng.chance(0.5);
  const double speed = (back ? -1 : 1) * rng.uniform(0.9, 1.6);
  const double s = road_.path_length_at(time);
  const double lateral = rng.chance(0.6) ? rng.uniform(4, 6.5) : rng.uniform(-10, -7.5);
  add({kPerson, half}, FeatureObject::Kind::kArticulated, time - 20, time + 4, [&, this](double t) {
    return on(s + speed * (t - time), lateral, back ? std::numbers::pi : 0, half);
  });
}

void TrafficMaker::cycle(double time, Rng& rng) {
  const Vector3d half(0.3, 0.85, 0.9);
  const double speed = rng.uniform(3.5, 5.5);
  const double s = road_.path_length_at(time);
  add({kBicycle, half}, FeatureObject::Kind::kRigid, time - 20, time + 4,
      [&, this](double t) { return on(s + speed * (t - time), 2.1, 0, half); });
}

// Where the camera waits, others have right of way.
void TrafficMaker::at_stops() {
  Rng rng(hash_of(seed_, 23));
  for (double t = road_.first_time(); t < road_.last_time(); t += 0.1) {
    if (road_.speed_at(t) > 0.4) continue;
    double end = t;
    while (end < road_.last_time() && road_.speed_at(end) <= 0.4) end += 0.1;
    if (end - t > 1) waiting(t, end, rng);
    t = end;
  }
}

void TrafficMaker::waiting(double from, double to, Rng& rng) {
  const double s = road_.path_length_at(0.5 * (from + to)) + (has_lead(from) ? 24 : 13);
  for (double t = from; t < to - 0.5;) {
    const double speed = rng.uniform(6, 10);
    crossing(t, s + (rng.chance(0.5) ? 3.4 : 0), speed, rng);
    t -= density_.at_stops * std::log(1 - rng.uniform());
    t += 0.8;
  }
  if (!has_lead(from) && to - from > 4) {
    const Vector3d half(0.28, 0.86, 0.2);
    const double speed = rng.uniform(1.1, 1.5);
    const double middle = from + 0.4 * (to - from);
    const double at = s - 7;
    add({kPerson, half}, FeatureObject::Kind::kArticulated, middle - 8, middle + 8,
        [&, this](double t) {
          return on(at, 0, std::numbers::pi / 2, half) *
                 Rigid3(Eigen::Quaterniond::Identity(), Vector3d(0, 0, speed * (t - middle)));
        });
  }
}

std::vector<FeatureObject> TrafficMaker::on_road() {
  leads();
  each(1, density_.oncoming, [this](double t, Rng& rng) { oncoming(t, rng); });
  each(2, density_.overtaking, [this](double t, Rng& rng) { overtaking(t, rng); });
  each(3, density_.crossing, [this](double t, Rng& rng) {
    if (!has_lead(t)) crossing(t, road_.path_length_at(t + 2.5) + 5, rng.uniform(6, 10), rng);
  });
  each(4, density_.walkers, [this](double t, Rng& rng) { walker(t, rng); });
  each(5, density_.cycles, [this](double t, Rng& rng) { cycle(t, rng); });
  at_stops();
  return std::move(objects_);
}

// The axis of the world that points up, as the cameras hold their heads.
Vector3d up_of(const FeaturePath& path) {
  Vector3d sum = Vector3d::Zero();
  for (const TimedPose& pose : path.poses) sum -= pose.T_w_c.rotation * Vector3d::UnitY();
  Eigen::Index axis = 0;
  sum.cwiseAbs().maxCoeff(&axis);
  return Vector3d::Unit(axis) * (sum[axis] < 0 ? -1.0 : 1.0);
}

// Crosses the view two to seven metres ahead of where the camera is at that time.
void TrafficMaker::person_in_room(double time, Rng& rng) {
  const Vector3d up = up_of(path_);
  double floor = std::numeric_limits<double>::infinity();
  std::size_t frame = 0;
  for (std::size_t i = 0; i < path_.poses.size(); ++i) {
    floor = std::min(floor, up.dot(path_.poses[i].T_w_c.t()) - 0.1);
    if (path_.poses[i].timestamp <= time) frame = i;
  }
  const Rigid3& T_w_c = path_.poses[frame].T_w_c;
  const auto level = [&](const Vector3d& v) { return Vector3d(v - up * up.dot(v)).normalized(); };
  const Vector3d ahead = level(T_w_c.rotation * Vector3d::UnitZ());
  const double side = rng.chance(0.5) ? 1 : -1;
  const Vector3d aside = side * ahead.cross(up);
  const Vector3d way = level(aside + rng.uniform(-0.7, 0.7) * ahead);
  const double speed = rng.uniform(0.7, 1.5);
  const Vector3d half(0.28, rng.uniform(0.8, 0.93), 0.2);
  const double offset = rng.uniform(-1, 1);
  const double distance = rng.uniform(2, 7);
  Vector3d start = T_w_c.t() + distance * ahead + offset * aside;
  start += up * (floor - up.dot(start));
  Eigen::Matrix3d R;  // x right, y down, z forward
  R << (-up).cross(way), -up, way;
  const auto person = [&](double t) {
    return Rigid3(R, start + up * half.y() + way * speed * (t - time));
  };
  add({kPerson, half}, FeatureObject::Kind::kArticulated, time - 5, time + 5, person);
  if (!rng.chance(0.3)) return;
  const Vector3d box(0.3, 0.25, 0.2);
  add({kSuitcase, box}, FeatureObject::Kind::kRigid, time - 5, time + 5, [&](double t) {
    return person(t) * Rigid3(Eigen::Quaterniond::Identity(), Vector3d(0, -0.25, 0.45));
  });
}

std::vector<FeatureObject> TrafficMaker::in_room() {
  each(6, density_.people, [this](double t, Rng& rng) { person_in_room(t, rng); });
  return std::move(objects_);
}

}  // namespace

Traffic parse_traffic(const std::string& name) {
  if (name == "none") return Traffic::kNone;
  if (name == "light") return Traffic::kLight;
  if (name == "city") return Traffic::kCity;
  if (name == "jam") return Traffic::kJam;
  throw InputError("--traffic: must be none, light, city or jam");
}

std::vector<FeatureObject> make_traffic(const FeaturePath& path, Traffic density,
                                        std::uint64_t seed) {
  if (density == Traffic::kNone || path.poses.size() < 2) return {};
  TrafficMaker maker(path, density, seed);
  return path.ground > 0 ? maker.on_road() : maker.in_room();
}

}  // namespace kys_slam::simulator
