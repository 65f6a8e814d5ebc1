// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <memory>
#include <vector>

#include "simulator/images/ray_kernel.h"
#include "simulator/images/sensor.h"
#include "simulator/worlds/world.h"

namespace kys_slam::simulator {

/// Data to shade a triangle, in the frame of its mesh.
struct SurfaceTriangle {
  Eigen::Vector3f v0, e1, e2, normal;  ///< normal of unit length
  Eigen::Vector2f uv0, uv1, uv2;       ///< uv1, uv2: differences to uv0
  Eigen::Vector3f grad_u, grad_v;      ///< d(uv)/d(point) within the plane
  Eigen::Vector3f n0, n1, n2;          ///< smooth normals
  std::uint16_t material = 0;
  bool smooth = false;
};

/// Data of a world that all frames share.
class RenderAssets {
 public:
  explicit RenderAssets(const World& world);

  const World& world;
  RayMeshes meshes;
  std::vector<std::vector<SurfaceTriangle>> surfaces;  ///< by prototype, triangle
};

/// Ground truth at each pixel centre of one view.
struct ViewTruth {
  ImageOf<std::int32_t> instance;  ///< index into Scene::instances, -1 sky
  ImageOf<float> depth;            ///< m along the optical axis, 0 sky
  ImageOf<Eigen::Vector2f> flow;   ///< px to the next frame, NaN where undefined; may be empty
  /// px, column in the left image - column in the right one, NaN in the sky and where the other
  /// camera is behind; empty for a rectified pair, where it follows from the depth.
  ImageOf<float> disparity;
};

/// Renders the frames of a world, one at a time; one instance per thread. The result depends on the
/// world and the frame index only.
class FrameRenderer {
 public:
  explicit FrameRenderer(const RenderAssets& assets);

  /// The image of the sensor; camera 0 is the left one.
  GrayImage image(int frame, int camera);
  /// Ground truth of the rectified view, with flow when there is a next frame.
  ViewTruth truth(int frame, int camera);

 private:
  struct View;
  void go_to(int frame);
  [[nodiscard]] View make_view(int frame, int camera, bool truth) const;
  struct Shading;
  struct SurfaceSample {
    float albedo;
    float facing;  // above zero: the back of the triangle
  };
  void shade_row(const View& view, int v, float* row) const;
  void cast_samples(const View& view, int u0, int v, Shading& out) const;
  void shade_sample(const View& view, int u0, int v, int k, Shading& out) const;
  [[nodiscard]] SurfaceSample look_at_surface(const View& view, const Shading& s, int k,
                                              const SurfaceTriangle& surface,
                                              const Eigen::Vector3f& step_u,
                                              const Eigen::Vector3f& step_v) const;
  static float disparity_between(const View& view, int u, const Eigen::Vector3d& p_c);
  void truth_row(const View& view, int v, ViewTruth& truth) const;
  [[nodiscard]] float sky(const Eigen::Vector3f& d, const Eigen::Vector3f& d_u,
                          const Eigen::Vector3f& d_v) const;

  const RenderAssets& assets_;
  RayScene scene_;
  int frame_ = -1;
};

/// T_w_o of every instance at a frame's time.
std::vector<Rigid3> instance_poses(const World& world, int frame);

}  // namespace kys_slam::simulator
