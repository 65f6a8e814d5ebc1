// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/triangulation.h"

#include <kys/portable_math.h>

#include <Eigen/SVD>
#include <cmath>
#include <optional>

#include "geometry/chi_square.h"
#include "geometry/reprojection.h"

namespace kys_slam {

void describe(kys::OptionList& list, TriangulationOptions& o) {
  list.add("mapping.triangulation_neighbours", o.neighbours, {0, 1000}, "",
           "covisible keyframes matched for new landmarks");
  list.add("mapping.min_parallax_cos", o.min_parallax_cos, {0, 1}, "",
           "largest cosine between two monocular rays");
  list.add("mapping.scale_tolerance", o.scale_tolerance, {1, 100}, "",
           "distance ratio against octave ratio, factor either way");
  describe(list, o.matching);
}

namespace {

/// A feature of a keyframe seen as a ray.
struct Ray {
  const KeyFrame* keyframe;
  std::size_t feature;
  Eigen::Vector3d direction_w;  // not normalised: depth 1
  double stereo_parallax_cos;   // of its own stereo match; 2: none

  Ray(const StereoCamera& camera, const KeyFrame& k, std::size_t f) : keyframe(&k), feature(f) {
    const Keypoint& p = k.features->keypoint(f);
    direction_w = k.T_c_w.rotation.conjugate() * camera.back_project(p.x, p.y, 1.0);
    stereo_parallax_cos =
        has_stereo() ? kys::portable::cos(2 * kys::portable::atan2(camera.baseline / 2, depth()))
                     : 2.0;
  }
  [[nodiscard]] bool has_stereo() const { return keyframe->features->has_stereo(feature); }
  [[nodiscard]] double depth() const { return keyframe->features->depth(feature); }
  [[nodiscard]] Eigen::Vector3d centre() const { return keyframe->T_c_w.inverse_t(); }
  [[nodiscard]] Eigen::Vector3d stereo_point() const { return centre() + depth() * direction_w; }
};

/// Linear triangulation (DLT) in the world frame.
std::optional<Eigen::Vector3d> intersect(const StereoCamera& camera, const Ray& a, const Ray& b) {
  Eigen::Matrix4d A;
  const auto rows = [&](const Ray& ray, int row) {
    const Keypoint& k = ray.keyframe->features->keypoint(ray.feature);
    const Eigen::Matrix<double, 3, 4> P = ray.keyframe->T_c_w.matrix();
    A.row(row) = (k.x - camera.cx) / camera.fx * P.row(2) - P.row(0);
    A.row(row + 1) = (k.y - camera.cy) / camera.fy * P.row(2) - P.row(1);
  };
  rows(a, 0);
  rows(b, 2);
  const Eigen::JacobiSVD<Eigen::Matrix4d> svd(A, Eigen::ComputeFullV);
  const Eigen::Vector4d X = svd.matrixV().col(3);
  if (std::abs(X.w()) < 1e-12) return std::nullopt;
  return X.head<3>() / X.w();
}

std::optional<Eigen::Vector3d> locate(const StereoCamera& camera, const Ray& a, const Ray& b,
                                      double min_parallax_cos) {
  const double ray_cos =
      a.direction_w.dot(b.direction_w) / (a.direction_w.norm() * b.direction_w.norm());
  const double stereo_cos = std::min(a.stereo_parallax_cos, b.stereo_parallax_cos);
  const bool any_stereo = a.has_stereo() || b.has_stereo();
  if (ray_cos < stereo_cos && ray_cos > 0 && (any_stereo || ray_cos < min_parallax_cos)) {
    return intersect(camera, a, b);
  }
  if (!any_stereo) return std::nullopt;
  return a.stereo_parallax_cos < b.stereo_parallax_cos ? a.stereo_point() : b.stereo_point();
}

bool reprojects(const StereoCamera& camera, const ScaleLevels& scales, const Ray& ray,
                const Eigen::Vector3d& p_w) {
  const Eigen::Vector3d p_c = ray.keyframe->T_c_w * p_w;
  if (p_c.z() <= 0) return false;
  const FrameFeatures& features = *ray.keyframe->features;
  const Keypoint& k = features.keypoint(ray.feature);
  const Eigen::Vector3d e =
      reprojection_error(camera, p_c, k.x, k.y, features.u_right(ray.feature));
  const double error = ray.has_stereo() ? e.squaredNorm() : e.head<2>().squaredNorm();
  const double bound = ray.has_stereo() ? kChi2Stereo95 : kChi2Mono95;
  const double inv_sigma = scales.inv_sigma(k.octave);
  return error * inv_sigma * inv_sigma <= bound;
}

/// The nearer of two views shows the landmark larger, on a higher octave, by the same ratio.
bool scale_agrees(const ScaleLevels& scales, const Ray& a, const Ray& b, const Eigen::Vector3d& p_w,
                  double tolerance) {
  if (!scales.sizes) tolerance = std::max<double>(tolerance, scales.reach);
  const double distance_a = (p_w - a.centre()).norm();
  const double distance_b = (p_w - b.centre()).norm();
  if (distance_a <= 0 || distance_b <= 0) return false;
  const auto scale = [&](const Ray& ray) {
    if (!scales.sizes) return 1.0;
    return static_cast<double>(scales.scale[ray.keyframe->features->keypoint(ray.feature).octave]);
  };
  const double ratio = distance_b / distance_a * scale(b) / scale(a);
  return ratio < tolerance && ratio * tolerance > 1;
}

std::vector<std::uint8_t> free_features(const KeyFrame& keyframe) {
  std::vector<std::uint8_t> free(keyframe.landmarks.size());
  for (std::size_t i = 0; i < free.size(); ++i) free[i] = keyframe.landmarks[i].valid() ? 0 : 1;
  return free;
}

}  // namespace

std::vector<LandmarkId> triangulate_landmarks(Map& map, KeyFrameId current,
                                              LandmarkIdAllocator& ids,
                                              const TriangulationOptions& options,
                                              const kys::DistanceModel& model,
                                              kys::Statistics& statistics) {
  std::vector<LandmarkId> made;
  const StereoCamera& camera = map.camera();
  const ScaleLevels& scales = map.scales();
  for (const KeyFrameId other : map.best_covisible(current, options.neighbours)) {
    const KeyFrame& a = map.keyframe(current);
    const KeyFrame& b = map.keyframe(other);
    const Rigid3 T_b_a = b.T_c_w * a.T_c_w.inverse();
    // Nearer than the stereo baseline there is nothing to gain over stereo itself.
    if (T_b_a.translation.norm() < camera.baseline) continue;
    const std::vector<FeaturePair> pairs =
        match_epipolar(camera, scales, *a.features, free_features(a), *b.features, free_features(b),
                       T_b_a, options.matching, model, statistics);
    for (const FeaturePair& pair : pairs) {
      const Ray ray_a(camera, a, pair.a);
      const Ray ray_b(camera, b, pair.b);
      const auto p_w = locate(camera, ray_a, ray_b, options.min_parallax_cos);
      if (!p_w || !p_w->allFinite()) continue;
      if (!reprojects(camera, scales, ray_a, *p_w) || !reprojects(camera, scales, ray_b, *p_w)) {
        continue;
      }
      if (!scale_agrees(scales, ray_a, ray_b, *p_w, options.scale_tolerance)) continue;
      Landmark landmark;
      landmark.id = ids.next();
      landmark.p_w = *p_w;
      landmark.first_keyframe = current;
      landmark.reference = current;
      const LandmarkId id = landmark.id;
      map.add_landmark(std::move(landmark));
      map.add_observation(id, current, pair.a);
      map.add_observation(id, other, pair.b);
      map.refresh_landmark(id);
      made.push_back(id);
    }
  }
  return made;
}

}  // namespace kys_slam
