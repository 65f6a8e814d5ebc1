// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>

#include <algorithm>

#include "simulator/common/euroc_rig.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {
namespace {

/// A raw camera of EuRoC whose image, rectified by its calibration, is that of `lens`.
struct RawView {
  Lens raw;                ///< calibration
  Eigen::Matrix3d R_c_s;   ///< raw camera to rectified axes, by calibration
  StereoCamera rectified;  ///< by calibration
  Lens lens;               ///< true one, of the rectified pair
  Eigen::Matrix3d R_o;     ///< axes of the true camera to those of the model

  [[nodiscard]] Eigen::Vector2d ray(double u, double v) const {
    const Eigen::Vector3d d_c = R_c_s * raw.ray(u, v).homogeneous();
    const Eigen::Vector2d pixel = rectified.project(d_c);
    return (R_o * lens.ray(pixel.x(), pixel.y()).homogeneous()).hnormalized();
  }
  [[nodiscard]] Eigen::Vector2d project(double x, double y) const {
    const Eigen::Vector2d d = (R_o.transpose() * Eigen::Vector3d(x, y, 1)).hnormalized();
    const Eigen::Vector2d pixel = lens.project(d.x(), d.y());
    const Eigen::Vector3d d_c = rectified.back_project(pixel.x(), pixel.y(), 1);
    const Eigen::Vector2d s = (R_c_s.transpose() * d_c).hnormalized();
    return raw.project(s.x(), s.y());
  }
};

CameraModel raw_camera(const RawView& view, int width, int height) {
  return {width, height, [view](double u, double v) { return view.ray(u, v); },
          [view](double x, double y) { return view.project(x, y); }};
}

// The images of the pair seen through EuRoC's raw cameras. Poses of the world are those of the raw
// left camera, so that its rays are in its axes; the model of the right one is in its true axes.
StereoRig raw_rig(const World& world, const TruePair& pair) {
  const int width = world.rig.left.width(), height = world.rig.left.height();
  const Eigen::Matrix3d R_c_b = euroc_rectifier(width, height).T_b_c().R().transpose();
  RawView views[2];
  for (int i = 0; i < 2; ++i) {
    views[i] = {euroc_lens(i, width, height), R_c_b * euroc_extrinsics(i).R(), world.rectified,
                i == 0 ? pair.left() : pair.right(), Eigen::Matrix3d::Identity()};
  }
  const Eigen::Matrix3d R_l_c = views[0].R_c_s.transpose();
  views[0].R_o = R_l_c;
  return {raw_camera(views[0], width, height), raw_camera(views[1], width, height),
          Rigid3(R_l_c, Eigen::Vector3d::Zero()) * pair.T_left_right()};
}

/// \throws InputError when the model has no one direction for each pixel
void check_invertible(const CameraModel& model) {
  for (int v = 0; v < model.height(); v += std::max(1, model.height() / 32)) {
    for (int u = 0; u < model.width(); u += std::max(1, model.width() / 32)) {
      const Eigen::Vector2d d = model.ray(u, v);
      if ((model.project(d.x(), d.y()) - Eigen::Vector2d(u, v)).norm() < 1e-6) continue;
      throw InputError("--rig-error: the distortion is too strong for the field of view");
    }
  }
}

}  // namespace

void apply_rig_error(World& world, const RigError& error) {
  const TruePair pair(world.rectified, error);
  world.rig_error = error;
  if (world.is_rectified()) return;
  const StereoCamera& k = world.rectified;
  world.truth_rig = {CameraModel(k.width, k.height, pair.left()),
                     CameraModel(k.width, k.height, pair.right()), pair.T_left_right()};
  world.rig = world.layout == Layout::kKitti ? world.truth_rig : raw_rig(world, pair);
  check_invertible(world.rig.left);
  check_invertible(world.rig.right);
}

}  // namespace kys_slam::simulator
