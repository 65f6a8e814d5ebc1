// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/traffic/replayed_objects.h"

#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/text_table.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <string>

#include "simulator/common/coco_classes.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

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

}  // namespace kys_slam::simulator
