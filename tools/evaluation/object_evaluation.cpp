// SPDX-License-Identifier: BSD-3-Clause
#include "object_evaluation.h"

#include <kys_slam/check_options.h>
#include <kys_slam/util/median.h>
#include <kys_slam/util/memory_limit.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <string>
#include <tuple>

namespace kys_slam {

void describe(kys::OptionList& list, ObjectEvaluationOptions& o) {
  list.add("--max-range", o.max_range, {0, 1e6}, "m");
  list.add("--min-keypoints", o.min_keypoints, {0, 1e9});
  list.add("--min-pixels", o.min_pixels, {0, 1e9}, "px");
  list.add("--max-distance", o.max_distance, {0, 1e6}, "m");
  list.add("min-life", o.min_life, {0, 1e9}, "frames");
  list.add("--first-frame", o.first_frame, {0, 1e9});
  list.add("--last-frame", o.last_frame, {0, 2e9});
  list.require(o.first_frame <= o.last_frame, "--first-frame is after --last-frame");
}
namespace {

constexpr double kMinHeadingSpeed = 1.0;  // m/s

using Key = std::pair<int, int>;
/// True objects by object and frame.
using Truth = std::map<Key, const TrueObject*>;

/// An estimate in the frame of the ground truth.
struct Moved {
  const EstimatedObject* row = nullptr;
  Eigen::Vector3d position, velocity;
  int object = -1;
};

std::vector<Moved> moved(const std::vector<EstimatedObject>& estimates,
                         const std::map<int, FramePoses>& frames, RelativeTo relative_to) {
  std::vector<Moved> out;
  for (const EstimatedObject& row : estimates) {
    const auto at = frames.find(row.frame);
    if (at == frames.end()) continue;
    const FramePoses& pose =
        relative_to == RelativeTo::kCamera ? at->second : frames.begin()->second;
    const Rigid3 T_g_w = pose.T_g_c * pose.T_w_c.inverse();
    out.push_back({&row, T_g_w * row.position, T_g_w.rotation * row.velocity});
  }
  std::stable_sort(out.begin(), out.end(), [](const Moved& a, const Moved& b) {
    return std::tie(a.row->frame, a.row->instance) < std::tie(b.row->frame, b.row->instance);
  });
  return out;
}

/// Estimates of one frame to its objects: those who were together before first, then by distance.
void assign_frame(std::vector<Moved>& moved, std::size_t begin, std::size_t end,
                  const std::vector<const TrueObject*>& objects, double max_distance,
                  std::map<int, int>& last_object) {
  using Pair = std::tuple<bool, double, std::size_t, std::size_t>;
  constexpr std::size_t kGrowth = 3;  // of a list that grows: what it has and twice as much
  check_memory("estimates and objects of frame " + std::to_string(moved[begin].row->frame),
               kGrowth * sizeof(Pair) * (end - begin) * objects.size());
  std::vector<Pair> pairs;
  for (std::size_t i = begin; i < end; ++i) {
    for (std::size_t j = 0; j < objects.size(); ++j) {
      const Eigen::Vector3d p = objects[j]->T_g_o.inverse() * moved[i].position;
      const double distance = distance_to_box(p, objects[j]->half);
      if (distance > max_distance) continue;
      const auto before = last_object.find(moved[i].row->instance);
      const bool is_new = before == last_object.end() || before->second != objects[j]->object;
      // Inside of two boxes at once, the nearer middle decides.
      pairs.emplace_back(is_new, distance + 1e-3 * p.norm(), i, j);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<bool> taken(objects.size(), false);
  for (const auto& [is_new, distance, i, j] : pairs) {
    if (moved[i].object >= 0 || taken[j]) continue;
    taken[j] = true;
    moved[i].object = objects[j]->object;
    last_object[moved[i].row->instance] = objects[j]->object;
  }
}

bool in_frames(int frame, const ObjectEvaluationOptions& options) {
  return frame >= options.first_frame && frame <= options.last_frame;
}

double median_of(std::vector<double> values) {
  return median(values);
}

/// The point of its box that each identity on an object tells of.
std::map<Key, Eigen::Vector3d> attached_points(const std::vector<Moved>& moved,
                                               const Truth& truth) {
  std::map<Key, std::array<std::vector<double>, 3>> seen;
  for (const Moved& m : moved) {
    if (m.object < 0) continue;
    const Eigen::Vector3d p = truth.at({m.object, m.row->frame})->T_g_o.inverse() * m.position;
    for (int axis = 0; axis < 3; ++axis) {
      seen[{m.row->instance, m.object}][static_cast<std::size_t>(axis)].push_back(p[axis]);
    }
  }
  std::map<Key, Eigen::Vector3d> points;
  for (const auto& [key, axes] : seen) {
    points[key] = {median_of(axes[0]), median_of(axes[1]), median_of(axes[2])};
  }
  return points;
}

/// Velocity (m/s) of a point of an object: central difference, one-sided where it comes or goes.
std::optional<Eigen::Vector3d> true_velocity(const Truth& truth, int object, int frame,
                                             const Eigen::Vector3d& p_o,
                                             const std::map<int, FramePoses>& frames) {
  const auto usable = [&](int f) { return truth.contains({object, f}) && frames.contains(f); };
  const int before = usable(frame - 1) ? frame - 1 : frame;
  const int after = usable(frame + 1) ? frame + 1 : frame;
  if (before == after) return std::nullopt;
  const Eigen::Vector3d way =
      truth.at({object, after})->T_g_o * p_o - truth.at({object, before})->T_g_o * p_o;
  return way / (frames.at(after).timestamp - frames.at(before).timestamp);
}

double range_of(const TrueObject& object, const std::map<int, FramePoses>& frames) {
  return (object.T_g_o.t() - frames.at(object.frame).T_g_c.t()).norm();
}

std::optional<ObjectError> error_of(const Moved& m, const Truth& truth,
                                    const Eigen::Vector3d& attached,
                                    const std::map<int, FramePoses>& frames,
                                    const ObjectEvaluationOptions& options) {
  const TrueObject& object = *truth.at({m.object, m.row->frame});
  const Eigen::Vector3d p_o = attached.cwiseMax(-object.half).cwiseMin(object.half);
  const auto velocity = true_velocity(truth, m.object, m.row->frame, p_o, frames);
  if (!velocity) return std::nullopt;
  ObjectError e;
  e.frame = m.row->frame;
  e.instance = m.row->instance;
  e.object = m.object;
  e.keypoints = m.row->keypoints;
  e.range = range_of(object, frames);
  e.counts = object.moving && e.range <= options.max_range && e.keypoints >= options.min_keypoints;
  e.position = (m.position - object.T_g_o * p_o).norm();
  e.outside = (attached - p_o).norm();
  e.speed = m.velocity.norm() - velocity->norm();
  e.velocity = (m.velocity - *velocity).norm();
  e.deviations = m.row->sigma_v > 0 ? e.velocity / m.row->sigma_v : 0;
  e.heading = std::numeric_limits<double>::quiet_NaN();
  if (velocity->norm() >= kMinHeadingSpeed && m.velocity.norm() > 0) {
    const double cosine = m.velocity.normalized().dot(velocity->normalized());
    e.heading = std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
  }
  return e;
}

void add_lives(const std::vector<Moved>& moved, const Truth& truth,
               const std::map<int, FramePoses>& frames, const ObjectEvaluationOptions& options,
               ObjectEvaluation& result) {
  std::map<Key, int> identity;  // by object and frame
  for (const Moved& m : moved) {
    if (m.object >= 0) identity[{m.object, m.row->frame}] = m.row->instance;
  }
  std::vector<ObjectLife>& lives = result.lives;
  std::map<int, int> frames_of;  // by identity, of the present object
  const auto finish = [&] {
    if (lives.empty()) return;
    ObjectLife& life = lives.back();
    for (const auto& [name, count] : frames_of) life.followed = std::max(life.followed, count);
    life.identities = static_cast<int>(frames_of.size());
    if (life.frames < options.min_life) {
      std::erase_if(result.life_frames, [&](const auto& row) { return row.object == life.object; });
      lives.pop_back();
    }
    frames_of.clear();
  };
  int present = -1;
  for (const auto& [key, object] : truth) {
    if (key.first != present) {
      finish();
      present = key.first;
      lives.push_back({key.first, object->kind, 0, 0, 0, 0});
    }
    if (!frames.contains(key.second) || !object->moving || !in_frames(key.second, options) ||
        range_of(*object, frames) > options.max_range ||
        (object->pixels >= 0 && object->pixels < options.min_pixels)) {
      continue;
    }
    ++lives.back().frames;
    result.life_frames.push_back(
        {object->object, object->frame, range_of(*object, frames), std::nullopt});
    if (const auto at = identity.find(key); at != identity.end()) {
      result.life_frames.back().identity = at->second;
      ++lives.back().reported;
      ++frames_of[at->second];
    }
  }
  finish();
}

}  // namespace

double distance_to_box(const Eigen::Vector3d& p, const Eigen::Vector3d& half) {
  return (p.cwiseAbs() - half).cwiseMax(0.0).norm();
}

ObjectEvaluation evaluate_objects(const std::vector<EstimatedObject>& estimates,
                                  const std::vector<TrueObject>& truth_rows,
                                  const std::map<int, FramePoses>& frames,
                                  const ObjectEvaluationOptions& options) {
  check_options(options);
  Truth truth;
  std::map<int, std::vector<const TrueObject*>> of_frame;
  for (const TrueObject& object : truth_rows) {
    truth[{object.object, object.frame}] = &object;
  }
  for (const auto& [key, object] : truth) of_frame[key.second].push_back(object);

  std::vector<Moved> rows = moved(estimates, frames, options.relative_to);
  std::map<int, int> last_object;
  for (std::size_t begin = 0; begin < rows.size();) {
    std::size_t end = begin;
    while (end < rows.size() && rows[end].row->frame == rows[begin].row->frame) ++end;
    assign_frame(rows, begin, end, of_frame[rows[begin].row->frame], options.max_distance,
                 last_object);
    begin = end;
  }

  ObjectEvaluation result;
  result.estimates = static_cast<int>(
      std::count_if(estimates.begin(), estimates.end(),
                    [&](const EstimatedObject& row) { return in_frames(row.frame, options); }));
  const auto points = attached_points(rows, truth);
  for (const Moved& m : rows) {
    if (!in_frames(m.row->frame, options)) continue;
    if (m.object < 0) {
      ++result.unassigned;
      continue;
    }
    if (!truth.at({m.object, m.row->frame})->moving) ++result.standing;
    const auto error = error_of(m, truth, points.at({m.row->instance, m.object}), frames, options);
    if (error) result.errors.push_back(*error);
  }
  add_lives(rows, truth, frames, options, result);
  return result;
}

}  // namespace kys_slam
