// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/object_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "simulator/traffic/object_motion.h"

namespace kys_slam::simulator {

std::vector<Presence> objects_near(const Rigid3& T_w_c, double reach,
                                   std::span<const FeatureObject> objects, std::size_t frame) {
  std::vector<Presence> out;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const Rigid3* T_w_o = pose_in_frame(objects[i], frame);
    if (T_w_o == nullptr || (T_w_o->t() - T_w_c.t()).norm() > reach) continue;
    out.push_back({static_cast<std::int32_t>(i), *T_w_o});
  }
  return out;
}

FrameScene scene_of(const StereoCamera& camera, const Rigid3& T_w_c,
                    std::span<const FeatureObject> objects, std::span<const Presence> present) {
  std::vector<std::int32_t> ids;
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> halves;
  for (const Presence& p : present) {
    ids.push_back(p.object);
    poses.push_back(p.T_w_o);
    halves.push_back(objects[static_cast<std::size_t>(p.object)].half_size.cast<double>());
  }
  const Rigid3 T_l_w = T_w_c.inverse();
  const Rigid3 T_r_l(Eigen::Quaterniond::Identity(), {-camera.baseline, 0, 0});
  auto left = boxes_in_view(camera, T_l_w, ids, poses, halves);
  auto right = boxes_in_view(camera, T_r_l * T_l_w, ids, poses, halves);
  BoxRaster left_raster(camera, left);
  BoxRaster right_raster(camera, right);
  std::size_t covered = 0;
  for (const std::int32_t id : left_raster.objects()) {
    if (id < 0) continue;
    const FeatureObject& object = objects[static_cast<std::size_t>(id)];
    covered += object.kind == FeatureObject::Kind::kStatic ? 0 : 1;
  }
  const auto blocks = static_cast<float>(left_raster.objects().size());
  return {std::move(left), std::move(right), std::move(left_raster), std::move(right_raster),
          static_cast<float>(covered) / blocks};
}

bool may_show(const FeatureObject& object, const Presence& presence, const FrameScene& scene) {
  return object.kind == FeatureObject::Kind::kArticulated ||
         std::ranges::binary_search(scene.left, presence.object, {}, &SeenBox::object);
}

void add_sights_on(const FeatureObject& object, const Presence& presence,
                   const StereoCamera& camera, const TimedPose& pose, const LandmarkMap& landmarks,
                   std::vector<Sight>& sights) {
  const Rigid3 T_o_c = presence.T_w_o.inverse() * pose.T_w_c;
  const Rigid3 T_c_o = T_o_c.inverse();
  const Eigen::Vector3d right_o = T_o_c * Eigen::Vector3d(camera.baseline, 0, 0);
  const bool sways = object.kind == FeatureObject::Kind::kArticulated;
  for (const LandmarkEntry& e : landmarks.of_object(static_cast<std::size_t>(presence.object))) {
    const int axis = std::abs(e.face) - 1;
    const double side = e.face > 0 ? 1 : -1;
    const double half = object.half_size[axis];
    const bool left_sees = side * T_o_c.t()[axis] > half;
    const bool right_sees = side * right_o[axis] > half;
    if ((!left_sees && !right_sees) || (!sways && e.is_out_of_range(T_o_c.t()))) continue;
    const Landmark& l = landmarks[e.id];
    Sight s{};
    s.id = e.id;
    if (sways) {
      Landmark moved = l;
      moved.p_w = sway(object, l.p_w, pose.timestamp);
      if (!sees(camera, moved, T_o_c, T_c_o, s)) continue;
    } else if (!sees(camera, l, T_o_c, T_c_o, s)) {
      continue;
    }
    s.hidden = {!left_sees, !right_sees};
    sights.push_back(s);
  }
}

void hide(const FrameScene& scene, const StereoCamera& camera, const LandmarkMap& landmarks,
          std::vector<Sight>& sights) {
  constexpr double kSlack = 0.01;  // m
  for (Sight& s : sights) {
    const std::int32_t own = landmarks[s.id].object;
    for (std::size_t side = 0; side < 2; ++side) {
      const double u = side == 0 ? s.pixel.x() : s.pixel.z();
      const double v = s.pixel.y();
      Eigen::Vector3d p = s.p_c;
      if (side == 1) p.x() -= camera.baseline;
      for (const SeenBox& box : side == 0 ? scene.left : scene.right) {
        if (s.hidden[side]) break;
        if (box.nearest >= p.z() - kSlack) continue;
        if (box.object == own || u < box.u0 || u > box.u1 || v < box.v0 || v > box.v1) continue;
        s.hidden[side] = depth_of_hit(box, p / p.z()) < p.z() - kSlack;
      }
    }
  }
}

}  // namespace kys_slam::simulator
