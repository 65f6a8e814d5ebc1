// SPDX-License-Identifier: BSD-3-Clause
#include "object_files.h"

#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

namespace kys_slam {
namespace {

namespace fs = std::filesystem;

constexpr double kSameTime = 1e-3;    // s
constexpr double kMovingSpeed = 0.5;  // m/s, where nothing else says what moves
constexpr std::size_t kKittiColumns = 17;
constexpr std::size_t kSimulatorColumns = 26;
constexpr std::size_t kVirtualColumns = 19;

int small_integer(const TextTable& table, const TextRow& row, std::size_t column) {
  const std::int64_t value = table.integer(row, column);
  // One less than the largest: there is always a next frame.
  if (value < 0 || value >= std::numeric_limits<int>::max()) {
    table.fail(row, "a number is out of range");
  }
  return static_cast<int>(value);
}

void expect_columns(const TextTable& table, const TextRow& row, std::size_t count) {
  if (row.fields.size() < count) {
    table.fail(row, std::to_string(row.fields.size()) + " columns where " + std::to_string(count) +
                        " are expected");
  }
}

Eigen::Vector3d vector_at(const TextTable& table, const TextRow& row, std::size_t column) {
  constexpr double kFar = 1e9;  // m or m/s: sums of such numbers are still numbers
  Eigen::Vector3d v(table.number(row, column), table.number(row, column + 1),
                    table.number(row, column + 2));
  if (!(v.cwiseAbs().maxCoeff() < kFar)) table.fail(row, "a number is out of range");
  return v;
}

/// A row of a CSV file as TextTable reads it, split at its commas instead: names have blanks, and
/// commas between quotes.
TextRow csv_row(const TextRow& row) {
  const char* const begin = row.fields.front().data();
  const char* const end = row.fields.back().data() + row.fields.back().size();
  const std::string_view line(begin, static_cast<std::size_t>(end - begin));
  TextRow out{row.line, {}};
  bool quoted = false;
  for (std::size_t first = 0, i = 0; i <= line.size(); ++i) {
    if (i < line.size() && line[i] == '"') quoted = !quoted;
    if (i < line.size() && (line[i] != ',' || quoted)) continue;
    std::string_view field = line.substr(first, i - first);
    while (field.starts_with(' ')) field.remove_prefix(1);
    while (field.ends_with(' ')) field.remove_suffix(1);
    out.fields.push_back(field);
    first = i + 1;
  }
  return out;
}

/// The text of a field that may be between quotes.
std::string unquoted(std::string_view field) {
  if (field.size() < 2 || !field.starts_with('"') || !field.ends_with('"')) {
    return std::string(field);
  }
  std::string text;
  for (std::size_t i = 1; i + 1 < field.size(); ++i) {
    if (field[i] == '"') ++i;  // two stand for one
    text += field[i];
  }
  return text;
}

std::vector<EstimatedObject> read_estimates(const fs::path& path) {
  const TextTable table(path);
  if (table.rows().empty() || table.rows().front().fields.front() != "frame") {
    throw InputError(path.string() + ": does not begin with the columns of a run's objects.csv");
  }
  std::vector<EstimatedObject> objects;
  std::set<std::pair<int, int>> seen;
  for (std::size_t i = 1; i < table.rows().size(); ++i) {
    const TextRow row = csv_row(table.rows()[i]);
    expect_columns(table, row, 14);
    EstimatedObject o;
    o.frame = small_integer(table, row, 0);
    o.instance = small_integer(table, row, 3);
    if (!seen.emplace(o.frame, o.instance).second) {
      table.fail(row, "instance " + std::to_string(o.instance) + " twice in frame " +
                          std::to_string(o.frame));
    }
    o.kind = unquoted(row.fields[4]);
    o.p_moving = table.number(row, 5);
    o.keypoints = small_integer(table, row, 6);
    o.position = vector_at(table, row, 7);
    o.velocity = vector_at(table, row, 10);
    o.sigma_v = table.number(row, 13);
    objects.push_back(o);
  }
  return objects;
}

/// Both files of a run have a row per frame. Frames outside the largest sub-map, in whose frame the
/// trajectory is, are left out: trajectory.kitti repeats the pose before them.
std::map<int, FramePoses> read_frames(const fs::path& folder) {
  const TextTable table(folder / "frames.csv");
  const std::vector<Rigid3> poses = read_kitti_poses(folder / "trajectory.kitti");
  if (table.rows().size() != poses.size() + 1) {
    throw InputError((folder / "frames.csv").string() + ": " + std::to_string(table.rows().size()) +
                     " lines, but trajectory.kitti has " + std::to_string(poses.size()));
  }
  std::map<std::int64_t, std::map<int, FramePoses>> submaps;
  std::set<int> seen;
  double last_time = 0;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const TextRow row = csv_row(table.rows()[k + 1]);
    expect_columns(table, row, 5);
    const FramePoses pose{table.number(row, 2), poses[k], poses[k]};
    if (k > 0 && pose.timestamp <= last_time) table.fail(row, "time stamps do not increase");
    last_time = pose.timestamp;
    const int index = small_integer(table, row, 0);
    if (!seen.insert(index).second) table.fail(row, "a frame for the second time");
    const std::int64_t submap = table.integer(row, 4);  // -1: lost
    if (submap >= 0) submaps[submap].emplace(index, pose);
  }
  // Of equal ones the first.
  const auto main =
      std::ranges::max_element(submaps, {}, [](const auto& entry) { return entry.second.size(); });
  return main == submaps.end() ? std::map<int, FramePoses>() : main->second;
}

/// Frames without ground truth are taken out.
void take_ground_truth(const fs::path& path, std::map<int, FramePoses>& frames) {
  const std::vector<TimedPose> truth = read_tum_poses(path, Stamps::kMayRepeat);
  std::map<int, FramePoses> found;
  for (auto& [index, frame] : frames) {
    const auto at =
        std::lower_bound(truth.begin(), truth.end(), frame.timestamp - kSameTime,
                         [](const TimedPose& pose, double time) { return pose.timestamp < time; });
    if (at == truth.end() || at->timestamp > frame.timestamp + kSameTime) continue;
    found[index] = {frame.timestamp, frame.T_w_c, at->T_w_c};
  }
  if (found.empty()) throw InputError(path.string() + ": no pose at the times of the run");
  frames = std::move(found);
}

/// Middle of a box and its axes (x forward, y left, z up) in the camera's frame, from the middle of
/// its bottom and its rotation about the camera's y axis (KITTI's location and rotation_y).
Rigid3 kitti_box_pose(const Eigen::Vector3d& bottom, double height, double rotation_y) {
  Eigen::Matrix3d R;
  R.col(0) = Eigen::Vector3d(std::cos(rotation_y), 0, -std::sin(rotation_y));
  R.col(2) = Eigen::Vector3d(0, -1, 0);
  R.col(1) = R.col(2).cross(R.col(0));
  return {R, bottom - Eigen::Vector3d(0, height / 2, 0)};
}

Eigen::Vector3d half_of(const TextTable& table, const TextRow& row, double length, double width,
                        double height) {
  const Eigen::Vector3d size(length, width, height);
  if (!(size.minCoeff() > 0)) table.fail(row, "a box without size");
  return size / 2;
}

std::vector<TrueObject> read_simulator(const TextTable& table,
                                       const std::map<int, FramePoses>& frames) {
  std::vector<TrueObject> objects;
  for (std::size_t i = 1; i < table.rows().size(); ++i) {
    const TextRow& row = table.rows()[i];
    expect_columns(table, row, kSimulatorColumns);
    // A class may have blanks in it: columns are counted from the end.
    const std::size_t shift = row.fields.size() - kSimulatorColumns;
    TrueObject o;
    o.frame = small_integer(table, row, 0);
    if (const auto frame = frames.find(o.frame);
        frame != frames.end() &&
        std::abs(table.number(row, 1) - frame->second.timestamp) > kSameTime) {
      table.fail(row, "the run has frame " + std::to_string(o.frame) + " at another time");
    }
    o.object = small_integer(table, row, 2);
    o.kind = row.fields[3];
    o.moving = table.integer(row, 5 + shift) != 0;
    const Eigen::Quaterniond q(table.number(row, 12 + shift), table.number(row, 9 + shift),
                               table.number(row, 10 + shift), table.number(row, 11 + shift));
    if (!(std::abs(q.norm() - 1) < 1e-3)) table.fail(row, "a quaternion that is not of length 1");
    const Rigid3 T_g_o(q, vector_at(table, row, 6 + shift));
    o.T_g_o = {T_g_o.rotation, T_g_o * vector_at(table, row, 16 + shift)};
    o.half = half_of(table, row, table.number(row, 19 + shift), table.number(row, 20 + shift),
                     table.number(row, 21 + shift));
    o.pixels = small_integer(table, row, 23 + shift);
    objects.push_back(o);
  }
  return objects;
}

/// Moves objects from the camera's frame to the ground truth's; frames the run lacks are left out.
void to_ground_truth(std::vector<TrueObject>& objects, const std::map<int, FramePoses>& frames) {
  std::erase_if(objects, [&](const TrueObject& o) { return !frames.contains(o.frame); });
  for (TrueObject& o : objects) o.T_g_o = frames.at(o.frame).T_g_c * o.T_g_o;
}

/// What moves, from the poses: more than `kMovingSpeed` from this frame to the next, or from the
/// one before where there is no next.
void find_moving(std::vector<TrueObject>& objects, const std::map<int, FramePoses>& frames) {
  std::map<std::pair<int, int>, const TrueObject*> at;
  for (const TrueObject& o : objects) at[{o.object, o.frame}] = &o;
  for (TrueObject& o : objects) {
    auto other = at.find({o.object, o.frame + 1});
    if (other == at.end()) other = at.find({o.object, o.frame - 1});
    if (other == at.end()) continue;
    const TrueObject& then = *other->second;
    const double dt = std::abs(frames.at(then.frame).timestamp - frames.at(o.frame).timestamp);
    o.moving = dt > 0 && (then.T_g_o.t() - o.T_g_o.t()).norm() / dt > kMovingSpeed;
  }
}

struct SeenBox {
  int pixels = -1;
  bool moving = false;
};

/// bbox.txt: frame cameraID trackID left right top bottom number_pixels truncation occupancy
/// moving.
std::map<std::pair<int, int>, SeenBox> read_boxes(const fs::path& path) {
  std::map<std::pair<int, int>, SeenBox> boxes;
  std::error_code error;
  if (!fs::exists(path, error)) return boxes;
  const TextTable table(path);
  for (const TextRow& row : table.rows()) {
    if (row.fields.front() == "frame") continue;
    expect_columns(table, row, 11);
    if (table.integer(row, 1) != 0) continue;
    const std::pair<int, int> key{small_integer(table, row, 2), small_integer(table, row, 0)};
    const SeenBox box{small_integer(table, row, 7), row.fields[10] == "True"};
    if (!boxes.emplace(key, box).second) table.fail(row, "an object twice in one frame");
  }
  return boxes;
}

std::vector<TrueObject> read_virtual_kitti(const TextTable& table,
                                           const std::map<int, FramePoses>& frames) {
  std::vector<TrueObject> objects;
  for (std::size_t i = 1; i < table.rows().size(); ++i) {
    const TextRow& row = table.rows()[i];
    expect_columns(table, row, kVirtualColumns);
    if (table.integer(row, 1) != 0) continue;  // the left camera
    TrueObject o;
    o.frame = small_integer(table, row, 0);
    o.object = small_integer(table, row, 2);
    const double width = table.number(row, 4), height = table.number(row, 5),
                 length = table.number(row, 6);
    o.half = half_of(table, row, length, width, height);
    o.T_g_o = kitti_box_pose(vector_at(table, row, 13), height, table.number(row, 16));
    objects.push_back(o);
  }
  to_ground_truth(objects, frames);
  const auto boxes = read_boxes(table.path().parent_path() / "bbox.txt");
  if (boxes.empty()) {
    find_moving(objects, frames);
    return objects;
  }
  std::erase_if(objects, [&](const TrueObject& o) { return !boxes.contains({o.object, o.frame}); });
  for (TrueObject& o : objects) {
    const SeenBox& seen = boxes.at({o.object, o.frame});
    o.pixels = seen.pixels;
    o.moving = seen.moving;
  }
  return objects;
}

/// KITTI's labels are in the rectified frame of camera 0; runs are of camera 2. Its calibration, as
/// in the data set, is calib/NAME.txt beside the folder of NAME.txt; without it zero.
double camera_2_shift(const fs::path& labels) {
  const fs::path path =
      fs::absolute(labels).parent_path().parent_path() / "calib" / labels.filename();
  std::error_code error;
  if (!fs::exists(path, error)) return 0;
  const TextTable table(path);
  for (const TextRow& row : table.rows()) {
    if (row.fields[0] != "P2:" && row.fields[0] != "P2") continue;
    expect_columns(table, row, 13);
    const double f = table.number(row, 1), shift = table.number(row, 4) / f;
    if (!(std::abs(shift) < 10)) table.fail(row, "camera 2 is more than 10 m from camera 0");
    return shift;
  }
  throw InputError(path.string() + ": has no line P2");
}

std::vector<TrueObject> read_kitti_labels(const TextTable& table,
                                          const std::map<int, FramePoses>& frames) {
  std::vector<TrueObject> objects;
  const Eigen::Vector3d shift(camera_2_shift(table.path()), 0, 0);
  for (const TextRow& row : table.rows()) {
    expect_columns(table, row, kKittiColumns);
    if (row.fields[2] == "DontCare") continue;
    TrueObject o;
    o.frame = small_integer(table, row, 0);
    o.object = small_integer(table, row, 1);
    o.kind = row.fields[2];
    const double height = table.number(row, 10), width = table.number(row, 11),
                 length = table.number(row, 12);
    o.half = half_of(table, row, length, width, height);
    o.T_g_o = kitti_box_pose(vector_at(table, row, 13) + shift, height, table.number(row, 16));
    objects.push_back(o);
  }
  to_ground_truth(objects, frames);
  find_moving(objects, frames);
  return objects;
}

/// In the format that the first line identifies.
std::vector<TrueObject> read_any_objects(const TextTable& table,
                                         const std::map<int, FramePoses>& frames) {
  if (table.rows().empty()) throw InputError(table.path().string() + ": is empty");
  const auto& first = table.rows().front().fields;
  if (first.size() == kSimulatorColumns && first[2] == "object")
    return read_simulator(table, frames);
  if (first.size() >= kVirtualColumns && first[1] == "cameraID") {
    return read_virtual_kitti(table, frames);
  }
  if (first.size() >= kKittiColumns && first[0] != "frame") {
    return read_kitti_labels(table, frames);
  }
  throw InputError(table.path().string() +
                   ": neither objects.csv of simulate_sequence, nor pose.txt of Virtual KITTI 2, "
                   "nor labels of KITTI Tracking");
}

}  // namespace

ObjectRun read_object_run(const fs::path& folder) {
  ObjectRun run;
  run.objects = read_estimates(folder / "objects.csv");
  run.frames = read_frames(folder);
  std::error_code error;
  run.has_ground_truth = fs::exists(folder / "ground_truth.tum", error);
  if (run.has_ground_truth) take_ground_truth(folder / "ground_truth.tum", run.frames);
  return run;
}

std::vector<TrueObject> read_true_objects(const fs::path& file,
                                          const std::map<int, FramePoses>& frames) {
  const TextTable table(file);
  std::vector<TrueObject> objects = read_any_objects(table, frames);
  std::set<std::pair<int, int>> seen;
  for (const TrueObject& o : objects) {
    if (seen.emplace(o.object, o.frame).second) continue;
    throw InputError(file.string() + ": object " + std::to_string(o.object) + " twice in frame " +
                     std::to_string(o.frame));
  }
  return objects;
}

}  // namespace kys_slam
