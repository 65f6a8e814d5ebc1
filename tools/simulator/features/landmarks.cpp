// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/landmarks.h"

#include <algorithm>
#include <cmath>

namespace kys_slam::simulator {
namespace {

/// Sets the pixel (u, v, u in the right image) of what is in front of the camera.
bool is_in_image(const StereoCamera& camera, const Eigen::Vector3d& p_c, Eigen::Vector3d& pixel) {
  if (p_c.z() < 0.2) return false;
  pixel = camera.project_stereo(p_c);
  return within_margin(camera, pixel.x(), pixel.y());
}

LandmarkEntry entry_of(const Landmark& l, std::int32_t id) {
  constexpr double kSlack = 1e-5;  // much more than sees() rounds
  const double farthest = l.max_distance;
  const double nearest =
      farthest / std::pow(kFeatureScale, std::min<double>(l.max_level, kFeatureLevels));
  return {l.p_w, static_cast<float>(nearest * nearest * (1 - kSlack)),
          static_cast<float>(farthest * farthest * (1 + kSlack)), id, l.face};
}

}  // namespace

bool sees(const StereoCamera& camera, const Landmark& l, const Rigid3& T_a_c, const Rigid3& T_c_a,
          Sight& sight) {
  // What costs least comes first: most landmarks are too far, or seen from aside.
  const Eigen::Vector3d view = T_a_c.t() - l.p_w;
  const double distance = view.norm();
  if (distance >= l.max_distance || distance < 0.2) return false;
  const double cosine = view.dot(l.normal.cast<double>()) / distance;
  if (cosine < l.min_cosine) return false;
  const Eigen::Vector3d p_c = T_c_a * l.p_w;
  if (!is_in_image(camera, p_c, sight.pixel)) return false;
  const double level = std::log(l.max_distance / distance) / std::log(kFeatureScale);
  sight.level = static_cast<float>(level);
  // As it is kept: rounding can make 8 of what is just below.
  if (sight.level >= kFeatureLevels || level >= l.max_level) return false;
  sight.p_c = p_c;
  sight.cosine = std::min(1.0, cosine);
  return true;
}

void LandmarkMap::add(const Landmark& landmark) {
  const auto id = static_cast<std::int32_t>(landmarks_.size());
  landmarks_.push_back(landmark);
  std::vector<LandmarkEntry>& entries = landmark.object < 0
                                            ? grid_[cell_key(cell_of(landmark.p_w))]
                                            : of_object_[static_cast<std::size_t>(landmark.object)];
  entries.push_back(entry_of(landmark, id));
}

std::vector<Sight> LandmarkMap::static_sights(const StereoCamera& camera,
                                              const Rigid3& T_w_c) const {
  std::vector<Sight> out;
  const Rigid3 T_c_w = T_w_c.inverse();
  const Eigen::Vector3i centre = cell_of(T_w_c.t());
  const int n = static_cast<int>(reach_ / cell_) + 1;
  const double slack = cell_ * 0.87;  // half the diagonal of a cell
  const double spread = 0.5 * std::hypot(camera.width, camera.height) / camera.fx;
  for (int x = -n; x <= n; ++x) {
    for (int y = -n; y <= n; ++y) {
      for (int z = -n; z <= n; ++z) {
        const Eigen::Vector3i c = centre + Eigen::Vector3i(x, y, z);
        const Eigen::Vector3d p = T_c_w * Eigen::Vector3d((c.cast<double>().array() + 0.5) * cell_);
        if (p.z() < -slack || p.head<2>().norm() > (p.z() + slack) * spread + 2 * slack) continue;
        const auto found = grid_.find(cell_key(c));
        if (found == grid_.end()) continue;
        for (const LandmarkEntry& e : found->second) {
          Sight s{};
          s.id = e.id;
          // As sees() finds, without reading the landmark.
          if (e.is_out_of_range(T_w_c.t()) || !is_in_image(camera, T_c_w * e.p_w, s.pixel))
            continue;
          if (sees(camera, (*this)[e.id], T_w_c, T_c_w, s)) out.push_back(s);
        }
      }
    }
  }
  return out;
}

std::vector<std::int32_t> LandmarkMap::static_near(const Eigen::Vector3d& p_w,
                                                   double radius) const {
  std::vector<std::int32_t> ids;
  const Eigen::Vector3i low = cell_of(p_w - Eigen::Vector3d::Constant(radius));
  const Eigen::Vector3i high = cell_of(p_w + Eigen::Vector3d::Constant(radius));
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) {
        const auto found = grid_.find(cell_key({x, y, z}));
        if (found == grid_.end()) continue;
        for (const LandmarkEntry& e : found->second) ids.push_back(e.id);
      }
    }
  }
  return ids;
}

}  // namespace kys_slam::simulator
