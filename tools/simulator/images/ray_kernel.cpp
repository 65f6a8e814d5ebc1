// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/ray_kernel.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#define KYS_EMBREE 4
#else
#include <embree3/rtcore.h>
#define KYS_EMBREE 3
#endif

#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

namespace kys_slam::simulator {
namespace {

// The call differs between Embree 3 and 4 only in what carries the "coherent" hint.
#if KYS_EMBREE == 4
struct Hint {
  RTCIntersectArguments intersect;
  RTCOccludedArguments occluded;
  Hint() {
    rtcInitIntersectArguments(&intersect);
    rtcInitOccludedArguments(&occluded);
    intersect.flags = RTC_RAY_QUERY_FLAG_COHERENT;
    occluded.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  }
};
void trace8(const int* valid, RTCScene s, Hint& h, RTCRayHit8* r) {
  rtcIntersect8(valid, s, r, &h.intersect);
}
void trace4(const int* valid, RTCScene s, Hint& h, RTCRayHit4* r) {
  rtcIntersect4(valid, s, r, &h.intersect);
}
void shade8(const int* valid, RTCScene s, Hint& h, RTCRay8* r) {
  rtcOccluded8(valid, s, r, &h.occluded);
}
void shade4(const int* valid, RTCScene s, Hint& h, RTCRay4* r) {
  rtcOccluded4(valid, s, r, &h.occluded);
}
#else
struct Hint {
  RTCIntersectContext context;
  Hint() {
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  }
};
void trace8(const int* valid, RTCScene s, Hint& h, RTCRayHit8* r) {
  rtcIntersect8(valid, s, &h.context, r);
}
void trace4(const int* valid, RTCScene s, Hint& h, RTCRayHit4* r) {
  rtcIntersect4(valid, s, &h.context, r);
}
void shade8(const int* valid, RTCScene s, Hint& h, RTCRay8* r) {
  rtcOccluded8(valid, s, &h.context, r);
}
void shade4(const int* valid, RTCScene s, Hint& h, RTCRay4* r) {
  rtcOccluded4(valid, s, &h.context, r);
}
#endif

template <int kWidth>
struct Wide;
template <>
struct Wide<8> {
  using RayHit = RTCRayHit8;
  using Ray = RTCRay8;
  static constexpr auto* trace = &trace8;
  static constexpr auto* shade = &shade8;
};
template <>
struct Wide<4> {
  using RayHit = RTCRayHit4;
  using Ray = RTCRay4;
  static constexpr auto* trace = &trace4;
  static constexpr auto* shade = &shade4;
};

template <int kWidth, typename Ray>
void load(const RayPacket& p, int first, float t_near, Ray& ray) {
  for (int i = 0; i < kWidth; ++i) {
    const int k = first + i;
    ray.org_x[i] = p.ox[k];
    ray.org_y[i] = p.oy[k];
    ray.org_z[i] = p.oz[k];
    ray.dir_x[i] = p.dx[k];
    ray.dir_y[i] = p.dy[k];
    ray.dir_z[i] = p.dz[k];
    ray.tnear[i] = t_near;
    ray.tfar[i] = p.t[k];
    ray.time[i] = 0;
    ray.mask[i] = 0xffffffffU;
    ray.id[i] = 0;
    ray.flags[i] = 0;
  }
}

template <int kWidth>
void intersect_wide(RTCScene scene, RayPacket& p) {
  for (int first = 0; first < kPacket; first += kWidth) {
    alignas(64) int valid[kWidth];
    alignas(64) typename Wide<kWidth>::RayHit hit;
    load<kWidth>(p, first, 0.0F, hit.ray);
    for (int i = 0; i < kWidth; ++i) {
      valid[i] = p.active[first + i] ? -1 : 0;
      hit.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      hit.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    Hint hint;
    Wide<kWidth>::trace(valid, scene, hint, &hit);
    for (int i = 0; i < kWidth; ++i) {
      const int k = first + i;
      const bool found = valid[i] != 0 && hit.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
      p.instance[k] = found ? static_cast<int>(hit.hit.instID[0][i]) : -1;
      if (!found) continue;
      p.triangle[k] = static_cast<int>(hit.hit.primID[i]);
      p.t[k] = hit.ray.tfar[i];
      p.u[k] = hit.hit.u[i];
      p.v[k] = hit.hit.v[i];
    }
  }
}

template <int kWidth>
void occluded_wide(RTCScene scene, const RayPacket& p, std::array<bool, kPacket>& blocked) {
  for (int first = 0; first < kPacket; first += kWidth) {
    alignas(64) int valid[kWidth];
    alignas(64) typename Wide<kWidth>::Ray ray;
    load<kWidth>(p, first, 1e-3F, ray);
    for (int i = 0; i < kWidth; ++i) valid[i] = p.active[first + i] ? -1 : 0;
    Hint hint;
    Wide<kWidth>::shade(valid, scene, hint, &ray);
    for (int i = 0; i < kWidth; ++i) blocked[first + i] = valid[i] != 0 && ray.tfar[i] < 0;
  }
}

}  // namespace

struct RayMeshes::Impl {
  RTCDevice device = nullptr;
  std::vector<RTCScene> meshes;
  bool wide = false;  ///< packets of 8 are native

  ~Impl() {
    for (RTCScene mesh : meshes) rtcReleaseScene(mesh);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

RayMeshes::RayMeshes(const Scene& scene) : impl_(std::make_unique<Impl>()) {
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl_->device == nullptr) throw std::runtime_error("Embree cannot start");
  impl_->wide = rtcGetDeviceProperty(impl_->device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0;
  for (const Mesh& mesh : scene.prototypes) {
    RTCScene s = rtcNewScene(impl_->device);
    rtcSetSceneFlags(s, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry g = rtcNewGeometry(impl_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(
        g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
      std::memcpy(v + 3 * i, mesh.vertices[i].data(), 3 * sizeof(float));
    }
    auto* t = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                      3 * sizeof(unsigned), mesh.triangles.size());
    std::memcpy(t, mesh.triangles.data(), mesh.triangles.size() * 3 * sizeof(unsigned));
    rtcCommitGeometry(g);
    rtcAttachGeometry(s, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(s);
    impl_->meshes.push_back(s);
  }
}

RayMeshes::~RayMeshes() = default;

struct RayScene::Impl {
  RTCScene scene = nullptr;
  std::vector<RTCGeometry> instances;
  bool wide = false;
  ~Impl() {
    for (RTCGeometry g : instances) rtcReleaseGeometry(g);
    if (scene != nullptr) rtcReleaseScene(scene);
  }
};

RayScene::RayScene(const RayMeshes& meshes, const Scene& scene)
    : impl_(std::make_unique<Impl>()), scene_(scene), poses_(scene.instances.size()) {
  const RayMeshes::Impl& shared = meshes.impl();
  impl_->wide = shared.wide;
  impl_->scene = rtcNewScene(shared.device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  for (const Instance& instance : scene.instances) {
    RTCGeometry g = rtcNewGeometry(shared.device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(g, shared.meshes[static_cast<std::size_t>(instance.prototype)]);
    rtcAttachGeometry(impl_->scene, g);
    impl_->instances.push_back(g);
  }
}

RayScene::~RayScene() = default;

void RayScene::set_time(double time) {
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const Instance& instance = scene_.instances[i];
    poses_[i] = instance.motion ? instance.motion(time) : instance.T_w_o;
    Eigen::Matrix<float, 3, 4, Eigen::ColMajor> M = poses_[i].matrix().cast<float>();
    M.leftCols<3>() *= static_cast<float>(instance.scale);
    rtcSetGeometryTransform(impl_->instances[i], 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, M.data());
    rtcCommitGeometry(impl_->instances[i]);
  }
  rtcCommitScene(impl_->scene);
}

void RayScene::intersect(RayPacket& rays) const {
  if (impl_->wide) {
    intersect_wide<8>(impl_->scene, rays);
  } else {
    intersect_wide<4>(impl_->scene, rays);
  }
}

void RayScene::occluded(const RayPacket& rays, std::array<bool, kPacket>& blocked) const {
  if (impl_->wide) {
    occluded_wide<8>(impl_->scene, rays, blocked);
  } else {
    occluded_wide<4>(impl_->scene, rays, blocked);
  }
}

}  // namespace kys_slam::simulator
