// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/object_truth.h"

#include <fmt/printf.h>

#include <cinttypes>
#include <map>

#include "simulator/common/coco_classes.h"

namespace kys_slam::simulator {
namespace {

constexpr double kHalfStep = 0.005;  // s, of the difference that velocities are

Rigid3 pose_at(const Instance& instance, double t) {
  return instance.motion ? instance.motion(t) : instance.T_w_o;
}

const Segment* find(const Panoptic& panoptic, int object) {
  for (const Segment& s : panoptic.segments) {
    if (s.object == object) return &s;
  }
  return nullptr;
}

}  // namespace

ObjectTruth::ObjectTruth(const World& world) : world_(world) {
  if (world.layout == Layout::kKitti) T_g_w_ = world.T_w_c.front().inverse();
  std::map<int, Object> found;
  for (std::size_t i = 0; i < world.scene.instances.size(); ++i) {
    const Instance& part = world.scene.instances[i];
    if (!world.scene.objects[static_cast<std::size_t>(part.object)].can_move) continue;
    Object& object = found[part.object];
    object.object = part.object;
    object.parts.push_back(static_cast<int>(i));
    const double t = world.times.front();
    const Instance& first = world.scene.instances[static_cast<std::size_t>(object.parts.front())];
    const Rigid3 T_o_part = pose_at(first, t).inverse() * pose_at(part, t);
    for (const auto& v :
         world.scene.prototypes[static_cast<std::size_t>(part.prototype)].vertices) {
      object.box.extend(T_o_part * (part.scale * v.cast<double>()).eval());
    }
  }
  for (auto& [number, object] : found) objects_.push_back(std::move(object));
}

std::vector<ObjectTruth::Row> ObjectTruth::rows(int frame) const {
  const double t = world_.times[static_cast<std::size_t>(frame)];
  std::vector<Row> rows;
  for (const Object& object : objects_) {
    const Instance& first = world_.scene.instances[static_cast<std::size_t>(object.parts.front())];
    Row row;
    row.object = object.object;
    row.T_g_o = T_g_w_ * pose_at(first, t);
    row.velocity = T_g_w_.rotation *
                   (pose_at(first, t + kHalfStep).t() - pose_at(first, t - kHalfStep).t()) /
                   (2 * kHalfStep);
    row.box = object.box;
    rows.push_back(row);
  }
  return rows;
}

const char* ObjectTruth::csv_header() {
  return "frame,timestamp,object,class,category_id,moving,x,y,z,qx,qy,qz,qw,vx,vy,vz,"
         "box_x,box_y,box_z,length,width,height,left_id,left_pixels,right_id,right_pixels\n";
}

std::string ObjectTruth::csv(int frame, const std::vector<bool>& moving, const Panoptic& left,
                             const Panoptic& right) const {
  std::string text;
  for (const Row& row : rows(frame)) {
    const Segment* l = find(left, row.object);
    const Segment* r = find(right, row.object);
    if (l == nullptr && r == nullptr) continue;
    const int category = world_.scene.objects[static_cast<std::size_t>(row.object)].category;
    text += fmt::sprintf(
        "%d,%.9f,%d,%s,%d,%d", frame, world_.times[static_cast<std::size_t>(frame)], row.object,
        coco_name(category), category, moving[static_cast<std::size_t>(row.object)] ? 1 : 0);
    const Eigen::Vector3d p = row.T_g_o.t();
    const Eigen::Quaterniond& q = row.T_g_o.rotation;
    const Eigen::Vector3d c = row.box.center(), size = row.box.sizes();
    text += fmt::sprintf(",%.6f,%.6f,%.6f,%.9f,%.9f,%.9f,%.9f,%.6f,%.6f,%.6f", p.x(), p.y(), p.z(),
                         q.x(), q.y(), q.z(), q.w(), row.velocity.x(), row.velocity.y(),
                         row.velocity.z());
    text += fmt::sprintf(",%.4f,%.4f,%.4f,%.4f,%.4f,%.4f", c.x(), c.y(), c.z(), size.x(), size.y(),
                         size.z());
    for (const Segment* s : {l, r}) {
      text += fmt::sprintf(",%u,%" PRId64, s != nullptr ? s->id : 0U,
                           s != nullptr ? s->area : std::int64_t{0});
    }
    text += "\n";
  }
  return text;
}

CoveredShare covered_share(const World& world, const Panoptic& left) {
  CoveredShare share;
  const double pixels = static_cast<double>(left.ids.size());
  for (const Segment& s : left.segments) {
    if (s.object < 0 || !world.scene.objects[static_cast<std::size_t>(s.object)].can_move) continue;
    (s.moving ? share.moving : share.standing) += static_cast<double>(s.area) / pixels;
  }
  return share;
}

}  // namespace kys_slam::simulator
