// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/renderer.h"

#include <cmath>
#include <limits>

namespace kys_slam::simulator {
namespace {

// Rotated grid: four samples in distinct rows and columns of the pixel.
constexpr float kSampleU[4] = {-0.125F, 0.375F, 0.125F, -0.375F};
constexpr float kSampleV[4] = {-0.375F, -0.125F, 0.375F, 0.125F};
constexpr float kFootprint = 0.7F;  // px per sample: together they cover the pixel
constexpr int kMaxProbes = 6;
constexpr float kFar = 3000.0F;

SurfaceTriangle make_surface(const Mesh& mesh, std::size_t index) {
  const auto& t = mesh.triangles[index];
  SurfaceTriangle s;
  s.v0 = mesh.vertices[t[0]];
  s.e1 = mesh.vertices[t[1]] - s.v0;
  s.e2 = mesh.vertices[t[2]] - s.v0;
  s.normal = s.e1.cross(s.e2).normalized();
  s.uv0 = mesh.uvs[t[0]];
  s.uv1 = mesh.uvs[t[1]] - s.uv0;
  s.uv2 = mesh.uvs[t[2]] - s.uv0;
  // Dual basis of the edges: b1.e1 = 1, b1.e2 = 0.
  const float a = s.e1.squaredNorm();
  const float b = s.e1.dot(s.e2);
  const float c = s.e2.squaredNorm();
  const float det = std::max(a * c - b * b, 1e-20F);
  const Eigen::Vector3f b1 = (c * s.e1 - b * s.e2) / det;
  const Eigen::Vector3f b2 = (a * s.e2 - b * s.e1) / det;
  s.grad_u = s.uv1.x() * b1 + s.uv2.x() * b2;
  s.grad_v = s.uv1.y() * b1 + s.uv2.y() * b2;
  s.n0 = mesh.normals[t[0]];
  s.n1 = mesh.normals[t[1]];
  s.n2 = mesh.normals[t[2]];
  s.smooth = !s.n0.isZero();
  s.material = mesh.materials[index];
  return s;
}

float tone(float light) {
  return 255.0F * std::pow(std::max(light, 0.0F), 0.62F);
}

}  // namespace

RenderAssets::RenderAssets(const World& w) : world(w), meshes(w.scene) {
  for (const Mesh& mesh : w.scene.prototypes) {
    std::vector<SurfaceTriangle> all;
    all.reserve(mesh.triangles.size());
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) all.push_back(make_surface(mesh, i));
    surfaces.push_back(std::move(all));
  }
}

namespace {

// T_w of a camera: of the one that takes images, or of the one the truth refers to.
Rigid3 camera_pose(const World& world, int frame, int camera, bool truth) {
  const Rigid3& T_w_l = (truth ? world.T_w_truth : world.T_w_c)[static_cast<std::size_t>(frame)];
  return camera == 0 ? T_w_l : T_w_l * (truth ? world.truth_rig : world.rig).T_left_right;
}

}  // namespace

std::vector<Rigid3> instance_poses(const World& world, int frame) {
  std::vector<Rigid3> poses;
  poses.reserve(world.scene.instances.size());
  const double time = world.times[static_cast<std::size_t>(frame)];
  for (const Instance& i : world.scene.instances) {
    poses.push_back(i.motion ? i.motion(time) : i.T_w_o);
  }
  return poses;
}

/// One camera at one moment, with what turns its rays into each instance's frame.
struct FrameRenderer::View {
  const CameraModel* model = nullptr;
  int frame = 0;
  int camera = 0;
  Rigid3 T_w_c;
  Eigen::Matrix3f R_w_c;
  Eigen::Vector3f origin;
  std::vector<Eigen::Matrix3f> R_w_o;
  std::vector<Eigen::Matrix3f> to_object;  ///< camera directions to object directions, / scale
  std::vector<Eigen::Matrix3d> R_c_o;      ///< times scale, for exact depths
  std::vector<Eigen::Vector3d> t_c_o;
  std::vector<Rigid3> T_next_now;  ///< camera frame now -> camera frame next, by instance
  Rigid3 T_next_now_static;
  bool has_next = false;
  const CameraModel* other = nullptr;  ///< the pair's other camera, if the pair is not rectified
  Rigid3 T_other_c;
};

FrameRenderer::FrameRenderer(const RenderAssets& assets)
    : assets_(assets), scene_(assets.meshes, assets.world.scene) {}

void FrameRenderer::go_to(int frame) {
  if (frame == frame_) return;
  scene_.set_time(assets_.world.times[static_cast<std::size_t>(frame)]);
  frame_ = frame;
}

FrameRenderer::View FrameRenderer::make_view(int frame, int camera, bool truth) const {
  const World& world = assets_.world;
  View view;
  const StereoRig& rig = truth ? world.truth_rig : world.rig;
  view.model = camera == 0 ? &rig.left : &rig.right;
  view.frame = frame;
  view.camera = camera;
  view.T_w_c = camera_pose(world, frame, camera, truth);
  view.R_w_c = view.T_w_c.R().cast<float>();
  view.origin = view.T_w_c.t().cast<float>();
  view.has_next = truth && frame + 1 < static_cast<int>(world.times.size());
  std::vector<Rigid3> next;
  Rigid3 T_next_w;
  if (view.has_next) {
    next = instance_poses(world, frame + 1);
    T_next_w = camera_pose(world, frame + 1, camera, truth).inverse();
    view.T_next_now_static = T_next_w * view.T_w_c;
  }
  if (truth && !world.is_rectified()) {
    view.other = camera == 0 ? &rig.right : &rig.left;
    view.T_other_c = camera == 0 ? rig.T_left_right.inverse() : rig.T_left_right;
  }
  const Rigid3 T_c_w = view.T_w_c.inverse();
  const auto& poses = scene_.poses();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double scale = world.scene.instances[i].scale;
    const Rigid3 T_c_o = T_c_w * poses[i];
    view.R_w_o.push_back(poses[i].R().cast<float>());
    view.to_object.emplace_back((T_c_o.R().transpose() / scale).cast<float>());
    view.R_c_o.emplace_back(T_c_o.R() * scale);
    view.t_c_o.push_back(T_c_o.t());
    if (view.has_next) {
      view.T_next_now.push_back(world.scene.instances[i].motion
                                    ? T_next_w * next[i] * poses[i].inverse() * view.T_w_c
                                    : view.T_next_now_static);
    }
  }
  return view;
}

float FrameRenderer::sky(const Eigen::Vector3f& d, const Eigen::Vector3f& d_u,
                         const Eigen::Vector3f& d_v) const {
  const auto plane = [](const Eigen::Vector3f& x) -> Eigen::Vector2f {
    const float k = 0.42F / (std::max(x.z(), 0.0F) / x.norm() + 0.22F) / x.norm();
    return {x.x() * k, x.y() * k};
  };
  const Eigen::Vector2f uv = plane(d);
  const Eigen::Vector2f du = (plane(d + d_u) - uv) * kFootprint;
  const Eigen::Vector2f dv = (plane(d + d_v) - uv) * kFootprint;
  const float cloud = assets_.world.scene.materials.appearances[kClouds].texture.sample(
      uv.x(), uv.y(), du.x(), du.y(), dv.x(), dv.y(), 4);
  const float height = std::max(0.0F, d.z() / d.norm());
  return assets_.world.scene.light.sky * (0.62F * cloud + 0.42F - 0.18F * height);
}

/// A packet of samples and what reaches the camera from each.
struct FrameRenderer::Shading {
  RayPacket rays;
  Eigen::Vector3f d_c[kPacket];  // ray directions in the camera frame
  float albedo[kPacket];
  float direct[kPacket];  // light of the sun, if nothing is in between
  float ambient[kPacket];
  RayPacket shadow;  // to the sun, of the samples it lights
  bool any_shadow = false;
};

/// Casts the four samples of each of two pixels.
void FrameRenderer::cast_samples(const View& view, int u0, int v, Shading& out) const {
  const int width = view.model->width();
  for (int k = 0; k < kPacket; ++k) {
    const int u = u0 + k / 4;
    out.rays.active[k] = u < width;
    const CameraModel::Ray& r = view.model->at(std::min(u, width - 1), v);
    const float a = kSampleU[k % 4];
    const float b = kSampleV[k % 4];
    out.d_c[k] = {r.x + a * r.x_u + b * r.x_v, r.y + a * r.y_u + b * r.y_v, 1.0F};
    const Eigen::Vector3f d = view.R_w_c * out.d_c[k];
    out.rays.ox[k] = view.origin.x();
    out.rays.oy[k] = view.origin.y();
    out.rays.oz[k] = view.origin.z();
    out.rays.dx[k] = d.x();
    out.rays.dy[k] = d.y();
    out.rays.dz[k] = d.z();
    out.rays.t[k] = kFar;
  }
  scene_.intersect(out.rays);
  out.shadow.active.fill(false);
}

/// Grey value of the surface that sample k met, and which side of it the camera sees: the first is
/// the texture's over the footprint of the sample, how the plane's point moves with the ray.
FrameRenderer::SurfaceSample FrameRenderer::look_at_surface(const View& view, const Shading& s,
                                                            int k, const SurfaceTriangle& surface,
                                                            const Eigen::Vector3f& step_u,
                                                            const Eigen::Vector3f& step_v) const {
  const Scene& scene = assets_.world.scene;
  const RayPacket& rays = s.rays;
  const auto i = static_cast<std::size_t>(rays.instance[k]);
  const Eigen::Matrix3f& M = view.to_object[i];
  const Eigen::Vector3f d_o = M * s.d_c[k];
  const Eigen::Vector3f u_o = M * step_u;
  const Eigen::Vector3f v_o = M * step_v;
  float facing = surface.normal.dot(d_o);
  if (std::abs(facing) < 1e-6F) facing = facing < 0 ? -1e-6F : 1e-6F;
  const float f = rays.t[k] * kFootprint;
  const Eigen::Vector3f p_u = f * (u_o - d_o * (surface.normal.dot(u_o) / facing));
  const Eigen::Vector3f p_v = f * (v_o - d_o * (surface.normal.dot(v_o) / facing));
  const Eigen::Vector2f uv = surface.uv0 + rays.u[k] * surface.uv1 + rays.v[k] * surface.uv2;
  const float uu = surface.grad_u.dot(p_u);
  const float vu = surface.grad_v.dot(p_u);
  const float uw = surface.grad_u.dot(p_v);
  const float vw = surface.grad_v.dot(p_v);
  const MaterialAppearance& appearance = scene.materials.appearances[surface.material];
  float a = appearance.texture.sample(uv.x() * appearance.scale_u, uv.y() * appearance.scale_v,
                                      uu * appearance.scale_u, vu * appearance.scale_v,
                                      uw * appearance.scale_u, vw * appearance.scale_v, kMaxProbes);
  if (appearance.grimy) {
    const float g = scene.materials.grime_scale;
    a *= 0.5F + 1.0F * scene.materials.grime.sample(uv.x() * g, uv.y() * g, uu * g, vu * g, uw * g,
                                                    vw * g, 3);
  }
  if (appearance.tinted) a *= scene.instances[i].tint;
  return {a, facing};
}

/// What sample k sees, and the ray from there to the sun.
void FrameRenderer::shade_sample(const View& view, int u0, int v, int k, Shading& out) const {
  const Scene& scene = assets_.world.scene;
  const Light& light = scene.light;
  const Eigen::Vector3f sun = light.to_sun.cast<float>();
  const RayPacket& rays = out.rays;
  out.albedo[k] = out.direct[k] = out.ambient[k] = 0;
  // Unused lanes still hold numbers.
  out.shadow.ox[k] = out.shadow.oy[k] = out.shadow.oz[k] = 0;
  out.shadow.dx[k] = sun.x();
  out.shadow.dy[k] = sun.y();
  out.shadow.dz[k] = sun.z();
  out.shadow.t[k] = 400.0F;
  if (!rays.active[k]) return;
  const CameraModel::Ray& r = view.model->at(u0 + k / 4, v);
  const Eigen::Vector3f step_u(r.x_u, r.y_u, 0);
  const Eigen::Vector3f step_v(r.x_v, r.y_v, 0);
  const Eigen::Vector3f d(rays.dx[k], rays.dy[k], rays.dz[k]);
  if (rays.instance[k] < 0) {
    out.albedo[k] = sky(d, view.R_w_c * step_u, view.R_w_c * step_v);
    out.ambient[k] = 1;
    return;
  }
  const auto i = static_cast<std::size_t>(rays.instance[k]);
  const SurfaceTriangle& s =
      assets_.surfaces[static_cast<std::size_t>(scene.instances[i].prototype)]
                      [static_cast<std::size_t>(rays.triangle[k])];
  const SurfaceSample seen = look_at_surface(view, out, k, s, step_u, step_v);
  out.albedo[k] = seen.albedo;
  Eigen::Vector3f n_o = s.normal;
  if (s.smooth) {
    n_o = (s.n0 * (1 - rays.u[k] - rays.v[k]) + s.n1 * rays.u[k] + s.n2 * rays.v[k]);
    n_o.normalize();
  }
  Eigen::Vector3f n = view.R_w_o[i] * n_o;
  if (seen.facing > 0) n = -n;
  out.ambient[k] = light.ambient * (0.68F + 0.32F * n.z());
  const float cosine = n.dot(sun);
  if (cosine <= 0) return;
  out.direct[k] = light.sun * cosine;
  const Eigen::Vector3f p = view.origin + d * rays.t[k] + n * (0.003F + 2e-5F * rays.t[k]);
  out.shadow.ox[k] = p.x();
  out.shadow.oy[k] = p.y();
  out.shadow.oz[k] = p.z();
  if (std::isfinite(light.shadow_ceiling)) {
    out.shadow.t[k] = (static_cast<float>(light.shadow_ceiling) - p.z()) / sun.z();
    if (out.shadow.t[k] <= 0) return;
  }
  out.shadow.active[k] = true;
  out.any_shadow = true;
}

void FrameRenderer::shade_row(const View& view, int v, float* row) const {
  const int width = view.model->width();
  for (int u0 = 0; u0 < width; u0 += 2) {
    Shading s;
    cast_samples(view, u0, v, s);
    for (int k = 0; k < kPacket; ++k) shade_sample(view, u0, v, k, s);
    if (s.any_shadow) {
      std::array<bool, kPacket> blocked;
      scene_.occluded(s.shadow, blocked);
      for (int k = 0; k < kPacket; ++k) {
        if (blocked[k]) s.direct[k] = 0;
      }
    }
    for (int k = 0; k < kPacket; k += 4) {
      if (!s.rays.active[k]) break;
      float sum = 0;
      for (int i = k; i < k + 4; ++i) sum += s.albedo[i] * (s.ambient[i] + s.direct[i]);
      row[u0 + k / 4] = tone(0.25F * sum);
    }
  }
}

/// Column in the left image - column in the right one of the point p_c, seen in column u.
float FrameRenderer::disparity_between(const View& view, int u, const Eigen::Vector3d& p_c) {
  const Eigen::Vector3d p = view.T_other_c * p_c;
  if (p_c.z() <= 0 || p.z() <= 0) return std::numeric_limits<float>::quiet_NaN();
  const double in_other = view.other->project(p.x() / p.z(), p.y() / p.z()).x();
  return static_cast<float>(view.camera == 0 ? u - in_other : in_other - u);
}

void FrameRenderer::truth_row(const View& view, int v, ViewTruth& truth) const {
  const Scene& scene = assets_.world.scene;
  const int width = view.model->width();
  for (int u0 = 0; u0 < width; u0 += kPacket) {
    RayPacket rays;
    for (int k = 0; k < kPacket; ++k) {
      rays.active[k] = u0 + k < width;
      const CameraModel::Ray& r = view.model->at(std::min(u0 + k, width - 1), v);
      const Eigen::Vector3f d = view.R_w_c * Eigen::Vector3f(r.x, r.y, 1);
      rays.ox[k] = view.origin.x();
      rays.oy[k] = view.origin.y();
      rays.oz[k] = view.origin.z();
      rays.dx[k] = d.x();
      rays.dy[k] = d.y();
      rays.dz[k] = d.z();
      rays.t[k] = kFar;
    }
    scene_.intersect(rays);
    for (int k = 0; k < kPacket && u0 + k < width; ++k) {
      const int u = u0 + k;
      const Eigen::Vector2d xy = view.model->ray(u, v);
      const Eigen::Vector3d d(xy.x(), xy.y(), 1);
      truth.instance.at(u, v) = rays.instance[k];
      double depth = 0;
      Eigen::Vector3d p_next = Eigen::Vector3d::Zero();
      if (rays.instance[k] >= 0) {
        const auto i = static_cast<std::size_t>(rays.instance[k]);
        const SurfaceTriangle& s =
            assets_.surfaces[static_cast<std::size_t>(scene.instances[i].prototype)]
                            [static_cast<std::size_t>(rays.triangle[k])];
        const Eigen::Vector3d n = view.R_c_o[i] * s.normal.cast<double>();
        const Eigen::Vector3d p0 = view.R_c_o[i] * s.v0.cast<double>() + view.t_c_o[i];
        const double facing = n.dot(d);
        // A plane seen edge-on has no exact depth: the kernel's is the best there is.
        depth = std::abs(facing) > 1e-5 * n.norm() ? n.dot(p0) / facing : rays.t[k];
        if (!(std::abs(depth - rays.t[k]) < 0.02 * rays.t[k])) depth = rays.t[k];
        if (view.has_next) p_next = view.T_next_now[i] * (d * depth);
      } else if (view.has_next) {
        p_next = view.T_next_now_static.rotation * d;
      }
      truth.depth.at(u, v) = static_cast<float>(depth);
      if (view.other != nullptr) {
        truth.disparity.at(u, v) = disparity_between(view, u, d * depth);
      }
      if (!view.has_next) continue;
      Eigen::Vector2f flow = Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());
      if (p_next.z() > 1e-2) {
        flow = (view.model->project(p_next.x() / p_next.z(), p_next.y() / p_next.z()) -
                Eigen::Vector2d(u, v))
                   .cast<float>();
      }
      truth.flow.at(u, v) = flow;
    }
  }
}

GrayImage FrameRenderer::image(int frame, int camera) {
  go_to(frame);
  const View view = make_view(frame, camera, false);
  const int width = view.model->width();
  const int height = view.model->height();
  const Sensor sensor{assets_.world.seed};
  const float exposure = Sensor::exposure(frame, camera, assets_.world.exposure_difference);
  ImageOf<float> light(width, height);
  for (int v = 0; v < height; ++v) {
    shade_row(view, v, &light.at(0, v));
    for (int u = 0; u < width; ++u) {
      light.at(u, v) = light.at(u, v) * exposure * Sensor::vignetting(u, v, width, height);
    }
  }
  Sensor::blur(light, assets_.world.blur[static_cast<std::size_t>(camera)]);
  GrayImage out(width, height);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) {
      const float g = light.at(u, v) + sensor.noise(frame, camera, u, v);
      out.at(u, v) = static_cast<std::uint8_t>(std::clamp(g, 0.0F, 255.0F) + 0.5F);
    }
  }
  return out;
}

ViewTruth FrameRenderer::truth(int frame, int camera) {
  go_to(frame);
  const View view = make_view(frame, camera, true);
  const int width = view.model->width();
  const int height = view.model->height();
  ViewTruth out;
  out.instance = ImageOf<std::int32_t>(width, height, -1);
  out.depth = ImageOf<float>(width, height);
  if (view.other != nullptr) out.disparity = ImageOf<float>(width, height);
  if (view.has_next) out.flow = ImageOf<Eigen::Vector2f>(width, height, Eigen::Vector2f::Zero());
  for (int v = 0; v < height; ++v) truth_row(view, v, out);
  return out;
}

}  // namespace kys_slam::simulator
