#include "traffic.h"

#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "drive_path.h"
#include "rng.h"
#include "scene.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

constexpr int kBicycle = 2;  // COCO ids the rendered worlds have no use for
constexpr int kSuitcase = 33;
constexpr double kBumper = 1.7;     // m, from the camera to the front of its own car
constexpr double kClearance = 1.1;  // m around the camera that nothing enters
constexpr double kSeen = 90;        // m, farther away nothing needs to exist
constexpr double kBehind = 15;      // m, likewise behind the camera
constexpr double kLeftLane = -3.4;  // m, to the right of the own lane's middle

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

Rigid3 turned(double yaw, const Vector3d& t) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3d::UnitY())), t};
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
    return road_.at(s) * turned(yaw, {lateral, path_.ground - half.y(), 0});
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
    crossing(t, s + (rng.chance(0.5) ? 3.4 : 0), rng.uniform(6, 10), rng);
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
  Vector3d start = T_w_c.t() + rng.uniform(2, 7) * ahead + rng.uniform(-1, 1) * aside;
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

using Cells = std::map<std::pair<int, int>, std::vector<Vector3d>>;

// Whether the camera ever comes so near to the box that its car would touch it.
bool in_the_way(const Rigid3& T_w_o, const Vector3d& half, const Cells& cells, double cell) {
  const Rigid3 T_o_w = T_w_o.inverse();
  const int x = static_cast<int>(std::floor(T_w_o.t().x() / cell));
  const int z = static_cast<int>(std::floor(T_w_o.t().z() / cell));
  for (int i = x - 1; i <= x + 1; ++i) {
    for (int k = z - 1; k <= z + 1; ++k) {
      const auto found = cells.find({i, k});
      if (found == cells.end()) continue;
      for (const Vector3d& p_w : found->second) {
        const Vector3d p = (T_o_w * p_w).cwiseAbs() - half;
        if (p.x() < 1.5 && p.z() < 1.5 && p.y() < 6) return true;
      }
    }
  }
  return false;
}

}  // namespace

Traffic parse_traffic(const std::string& name) {
  if (name == "none") return Traffic::kNone;
  if (name == "light") return Traffic::kLight;
  if (name == "city") return Traffic::kCity;
  if (name == "jam") return Traffic::kJam;
  throw InputError("--traffic: must be none, light, city or jam");
}

std::uint16_t coco_label(int category) {
  static const kys::LabelSpace space = kys::load_label_space(kFeatureLabelSpace);
  return category == kUnlabelled ? kys::kVoidLabel : space.index_of(category);
}

std::vector<FeatureObject> park_cars(const FeaturePath& path, std::uint64_t seed) {
  std::vector<FeatureObject> cars;
  if (path.ground <= 0) return cars;
  const DrivePath road(path.poses);
  constexpr double kCell = 12;
  Cells cells, parked;
  const auto put = [](Cells& to, const Vector3d& p) {
    to[{static_cast<int>(std::floor(p.x() / kCell)), static_cast<int>(std::floor(p.z() / kCell))}]
        .push_back(p);
  };
  for (double s = 0; s <= road.length(); s += 1) put(cells, road.at(s).t());
  Rng rng(hash_of(seed, 24));
  for (const double side : {1.0, -1.0}) {
    bool run = false;
    double run_end = 0;
    for (double s = 0; s < road.length(); s += 6.2) {
      if (s >= run_end) {
        run = rng.chance(0.45);
        run_end = s + rng.uniform(20, 60);
      }
      const double k = rng.uniform(0.93, 1.08);
      const bool taken = rng.chance(0.85);
      const double lateral = side > 0 ? 3.1 : kLeftLane - 3.0;
      if (!run || !taken) continue;
      const Vector3d half = k * Vector3d(0.9, 0.74, 2.15);
      const Rigid3 T_w_o =
          road.at(s) * turned(rng.uniform(-0.04, 0.04), {lateral, path.ground - half.y(), 0});
      if (in_the_way(T_w_o, half, cells, kCell) ||
          in_the_way(T_w_o, half + Vector3d(1, 0, 2), parked, kCell)) {
        continue;
      }
      put(parked, T_w_o.t());
      FeatureObject car;
      car.label = coco_label(kCar);
      car.half_size = half.cast<float>();
      car.poses = {T_w_o};
      cars.push_back(std::move(car));
    }
  }
  return cars;
}

std::vector<FeatureObject> make_traffic(const FeaturePath& path, Traffic density,
                                        std::uint64_t seed) {
  if (density == Traffic::kNone || path.poses.size() < 2) return {};
  TrafficMaker maker(path, density, seed);
  return path.ground > 0 ? maker.on_road() : maker.in_room();
}

namespace {

enum Column : std::size_t { kFrame = 0, kObject = 2, kCategory = 4, kMoving = 5, kPose = 6 };
constexpr std::size_t kBoxColumn = 16;  // centre, then length, width, height
constexpr std::size_t kObjectColumns = 22;
constexpr std::size_t kGrowth = 3;  // of a list that grows: what it has and twice as much

/// One row of objects.csv, with the axes of a camera: x right, y down, z ahead.
struct ObjectRow {
  std::int64_t frame = 0;
  int category = 0;
  bool moving = false;
  Rigid3 T_w_o;
  Vector3d half;
};

ObjectRow read_row(const TextTable& table, const TextRow& row) {
  if (row.fields.size() < kObjectColumns) table.fail(row, "too few columns");
  const auto number = [&](std::size_t column) { return table.number(row, column); };
  ObjectRow out;
  out.frame = table.integer(row, kFrame);
  out.category = static_cast<int>(table.integer(row, kCategory));
  out.moving = table.integer(row, kMoving) != 0;
  const Eigen::Quaterniond q(number(kPose + 6), number(kPose + 3), number(kPose + 4),
                             number(kPose + 5));
  const Vector3d size(number(kBoxColumn + 3), number(kBoxColumn + 4), number(kBoxColumn + 5));
  if (out.frame < 0 || std::abs(q.norm() - 1) > 1e-3 || size.minCoeff() <= 0) {
    table.fail(row, "the object makes no sense");
  }
  const Rigid3 T_w_g(q, {number(kPose), number(kPose + 1), number(kPose + 2)});
  const Vector3d centre(number(kBoxColumn), number(kBoxColumn + 1), number(kBoxColumn + 2));
  Eigen::Matrix3d axes;  // of the file's x forward, y left, z up
  axes << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  out.T_w_o = T_w_g * Rigid3(axes, centre);
  out.half = 0.5 * Vector3d(size.y(), size.z(), size.x());
  return out;
}

}  // namespace

std::vector<FeatureObject> read_objects(const std::filesystem::path& file, std::size_t frames) {
  const TextTable table(file);
  std::size_t poses = 0;
  std::map<std::int64_t, FeatureObject> objects;
  std::map<std::int64_t, bool> moves;
  for (const TextRow& row : table.rows()) {
    if (!row.fields.empty() && row.fields[0] == "frame") continue;
    const ObjectRow r = read_row(table, row);
    const std::int64_t id = table.integer(row, kObject);
    const auto [at, is_new] = objects.try_emplace(id);
    FeatureObject& o = at->second;
    moves[id] = moves[id] || r.moving;
    if (is_new) {
      o.label = coco_label(r.category);
      o.kind =
          r.category == kPerson ? FeatureObject::Kind::kArticulated : FeatureObject::Kind::kRigid;
      o.half_size = r.half.cast<float>();
      o.first_frame = r.frame;
    }
    const std::int64_t next = o.first_frame + static_cast<std::int64_t>(o.poses.size());
    if (r.frame < next) table.fail(row, "frames of an object must increase");
    if (r.frame >= static_cast<std::int64_t>(frames)) {
      table.fail(row, "the trajectory has " + std::to_string(frames) + " frames");
    }
    // Where no view shows it, it stays where it is seen next.
    const std::size_t added = static_cast<std::size_t>(r.frame - next) + 1;
    poses += added;
    check_memory(file.string(), kGrowth * sizeof(Rigid3) * poses);
    o.poses.insert(o.poses.end(), added, r.T_w_o);
  }
  std::vector<FeatureObject> out;
  for (auto& [id, object] : objects) {
    if (!moves[id]) {
      object.kind = FeatureObject::Kind::kStatic;
      object.first_frame = 0;
      object.poses.resize(1);
    }
    out.push_back(std::move(object));
  }
  if (out.empty()) throw InputError(file.string() + ": holds no objects");
  return out;
}

const Rigid3* pose_in_frame(const FeatureObject& object, std::size_t frame) {
  if (object.kind == FeatureObject::Kind::kStatic) return object.poses.data();
  const auto at = static_cast<std::int64_t>(frame) - object.first_frame;
  if (at < 0 || at >= static_cast<std::int64_t>(object.poses.size())) return nullptr;
  return &object.poses[static_cast<std::size_t>(at)];
}

Vector3d sway(const FeatureObject& object, const Vector3d& p_o, double time) {
  if (object.kind != FeatureObject::Kind::kArticulated) return p_o;
  // Arms and legs swing against each other, left against right, the more the farther from the
  // waist.
  constexpr double kStepsPerSecond = 0.95;
  const double height = p_o.y() / object.half_size.y();
  const double side = p_o.x() >= 0 ? 1 : -1;
  const double swing = 0.14 * height * side;
  return p_o + Vector3d(0, 0, swing * std::sin(2 * std::numbers::pi * kStepsPerSecond * time));
}

}  // namespace kys_slam::simulator
