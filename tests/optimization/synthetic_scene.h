// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "optimization/bundle_adjustment.h"
#include "optimization/pose_optimization.h"

namespace kys_slam::test {

inline constexpr float kNoRight = std::numeric_limits<float>::quiet_NaN();

inline StereoCamera kitti_camera() {
  StereoCamera camera;
  camera.width = 1241;
  camera.height = 376;
  camera.fx = camera.fy = 718.856;
  camera.cx = 607.1928;
  camera.cy = 185.2157;
  camera.baseline = 0.537;
  return camera;
}

/// Random numbers that are the same on every machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_() >> 11) * 0x1.0p-53);
  }
  double normal(double sigma) {  // Box-Muller
    const double radius = std::sqrt(-2.0 * std::log(uniform(1e-300, 1.0)));
    return sigma * radius * std::cos(uniform(0, 2 * M_PI));
  }
  Eigen::Vector3d vector(double sigma) { return {normal(sigma), normal(sigma), normal(sigma)}; }
  Eigen::Matrix<double, 6, 1> increment(double sigma_rad, double sigma_m) {
    Eigen::Matrix<double, 6, 1> d;
    d << vector(sigma_rad), vector(sigma_m);
    return d;
  }
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(engine_() % n); }

 private:
  std::mt19937_64 engine_;
};

struct SceneOptions {
  std::uint64_t seed = 1;
  int poses = 20;
  int fixed = 6;  ///< the first ones
  int points = 2500;
  double spacing = 1.0;     ///< m between keyframes
  int max_track = 6;        ///< keyframes that see a point, at most
  double mono_share = 0.3;  ///< of the observations
  double noise = 0;         ///< standard deviation at inv_sigma 1, px
};

/// A drive along z through a corridor of points, as a local window of a KITTI sequence sees it.
struct Scene {
  std::vector<Rigid3> T_c_w;            ///< true
  std::vector<Eigen::Vector3d> points;  ///< true
  BundleProblem problem;                ///< starts at the truth, with noisy observations
};

using Track = std::vector<BundleProblem::Observation>;

inline void add_point(Scene& scene, const Eigen::Vector3d& p_w, const Track& track) {
  scene.points.push_back(p_w);
  scene.problem.add_point(p_w);
  for (const BundleProblem::Observation& o : track) scene.problem.add_observation(o);
}

/// Noise number k of observations: 1.2^k px.
inline std::vector<float> inv_sigmas() {
  std::vector<float> all;
  for (int k = 0; k < 6; ++k) all.push_back(static_cast<float>(1.0 / std::pow(1.2, k)));
  return all;
}

inline Scene make_scene(const SceneOptions& options) {
  Random random(options.seed);
  Scene scene;
  scene.problem.camera = kitti_camera();
  scene.problem.inv_sigma = inv_sigmas();
  const StereoCamera& camera = scene.problem.camera;
  for (int i = 0; i < options.poses; ++i) {
    const double heading = 0.02 * i;
    const Rigid3 T_w_c(so3_exp({0.003 * std::sin(1.3 * i), heading, 0.002 * std::cos(0.7 * i)}),
                       Eigen::Vector3d(0.01 * i * i * options.spacing, 0.02 * std::sin(0.9 * i),
                                       options.spacing * i));
    scene.T_c_w.push_back(T_w_c.inverse());
    scene.problem.pose_fixed.push_back(i < options.fixed ? 1 : 0);
  }
  scene.problem.T_c_w = scene.T_c_w;
  while (static_cast<int>(scene.points.size()) < options.points) {
    // Made in one keyframe, then looked for in those that follow it.
    const std::size_t first = random.below(scene.T_c_w.size());
    const Eigen::Vector3d p_c = camera.back_project(
        random.uniform(10, camera.width - 10), random.uniform(10, camera.height - 10),
        std::exp(random.uniform(std::log(5.0), std::log(50.0))));
    const Eigen::Vector3d p_w = scene.T_c_w[first].inverse() * p_c;
    const int length = 3 + static_cast<int>(random.below(options.max_track - 2));
    Track track;
    for (std::size_t k = first; k < scene.T_c_w.size() && k < first + length; ++k) {
      const Eigen::Vector3d q = scene.T_c_w[k] * p_w;
      if (q.z() < 1) break;
      const Eigen::Vector3d uvr = camera.project_stereo(q);
      if (!camera.in_image(uvr.x(), uvr.y())) break;
      const auto noise = static_cast<std::uint8_t>(random.below(6));
      const double sigma = std::pow(1.2, static_cast<double>(noise));
      const bool mono = random.uniform(0, 1) < options.mono_share;
      BundleProblem::Observation o;
      o.pose = static_cast<std::uint32_t>(k);
      o.noise = noise;
      o.u = static_cast<float>(uvr.x() + random.normal(options.noise * sigma));
      o.v = static_cast<float>(uvr.y() + random.normal(options.noise * sigma));
      // The noise of the disparity is independent of that of u.
      const auto right =
          static_cast<float>(o.u - (uvr.x() - uvr.z()) + random.normal(options.noise * sigma));
      o.u_right = mono ? kNoRight : right;
      track.push_back(o);
    }
    if (track.size() >= 2) add_point(scene, p_w, track);
  }
  return scene;
}

/// What pose `k` sees of point `p_w`, if it does: appended to the track.
inline bool observe(const Scene& scene, Track& track, Random& random, std::size_t k,
                    const Eigen::Vector3d& p_w, double farthest, double mono_share, double noise) {
  const StereoCamera& camera = scene.problem.camera;
  const Eigen::Vector3d q = scene.T_c_w[k] * p_w;
  if (q.z() < 0.5 || q.z() > farthest) return false;
  const Eigen::Vector3d uvr = camera.project_stereo(q);
  if (!camera.in_image(uvr.x(), uvr.y())) return false;
  const auto level = static_cast<std::uint8_t>(random.below(6));
  const double sigma = std::pow(1.2, static_cast<double>(level));
  const bool mono = random.uniform(0, 1) < mono_share;
  BundleProblem::Observation o;
  o.pose = static_cast<std::uint32_t>(k);
  o.noise = level;
  o.u = static_cast<float>(uvr.x() + random.normal(noise * sigma));
  o.v = static_cast<float>(uvr.y() + random.normal(noise * sigma));
  const auto right = static_cast<float>(uvr.z() + random.normal(noise * sigma));
  o.u_right = mono ? kNoRight : right;
  track.push_back(o);
  return true;
}

/// Two laps of a town block, as a whole KITTI sequence: a landmark is seen by a handful of
/// keyframes on end, on two fifths of the way by those of the second lap too. About `points`
/// landmarks with 4.7 observations each.
inline Scene make_loop_scene(int poses, int points, double noise, std::uint64_t seed = 1) {
  Random random(seed);
  Scene scene;
  scene.problem.camera = kitti_camera();
  scene.problem.inv_sigma = inv_sigmas();
  const StereoCamera& camera = scene.problem.camera;
  const int lap = poses / 2;
  const double radius = 1.3 * lap / (2 * M_PI);
  for (int i = 0; i < poses; ++i) {
    const double angle = 2 * M_PI * (i % lap) / lap;
    const Rigid3 T_w_c(so3_exp({0.003 * std::sin(1.3 * i), angle, 0.002 * std::cos(0.7 * i)}),
                       Eigen::Vector3d(-radius * std::cos(angle) + 0.3 * (i / lap),
                                       0.02 * std::sin(0.9 * i), radius * std::sin(angle)));
    scene.T_c_w.push_back(T_w_c.inverse());
    scene.problem.pose_fixed.push_back(i == 0 ? 1 : 0);
  }
  scene.problem.T_c_w = scene.T_c_w;
  while (static_cast<int>(scene.points.size()) < points) {
    const std::size_t first = random.below(scene.T_c_w.size());
    const Eigen::Vector3d p_c = camera.back_project(
        random.uniform(10, camera.width - 10), random.uniform(10, camera.height - 10),
        std::exp(random.uniform(std::log(6.0), std::log(50.0))));
    const Eigen::Vector3d p_w = scene.T_c_w[first].inverse() * p_c;
    Track track;
    const std::size_t length = 3 + random.below(4) + (random.below(8) == 0 ? 8 : 0);
    const std::size_t again = first + static_cast<std::size_t>(lap);
    for (std::size_t k = first; k < scene.T_c_w.size() && k < first + length; ++k) {
      if (!observe(scene, track, random, k, p_w, 80, 0.3, noise)) break;
    }
    if (static_cast<int>(first) % lap < 2 * lap / 5 && random.below(2) == 0) {
      for (std::size_t k = again; k < scene.T_c_w.size() && k < again + length; ++k) {
        if (!observe(scene, track, random, k, p_w, 80, 0.3, noise)) break;
      }
    }
    if (track.size() >= 2) add_point(scene, p_w, track);
  }
  return scene;
}

/// A flight through a hall, as a EuRoC sequence: keyframes turn about and see the same walls again
/// and again, every one some 250 landmarks of `points` on the walls.
inline Scene make_hall_scene(int poses, int points, double noise, std::uint64_t seed = 1) {
  Random random(seed);
  Scene scene;
  scene.problem.camera = kitti_camera();
  scene.problem.inv_sigma = inv_sigmas();
  scene.problem.camera.height = 800;
  scene.problem.camera.cy = 400;
  for (int i = 0; i < poses; ++i) {
    const double s = 0.11 * i;
    const Rigid3 T_w_c(so3_exp({0.2 * std::sin(1.7 * s), 0.7 * s, 0.1 * std::cos(s)}),
                       Eigen::Vector3d(2 * std::sin(s), 0.8 * std::sin(0.63 * s), 2 * std::cos(s)));
    scene.T_c_w.push_back(T_w_c.inverse());
    scene.problem.pose_fixed.push_back(i == 0 ? 1 : 0);
  }
  scene.problem.T_c_w = scene.T_c_w;
  while (static_cast<int>(scene.points.size()) < points) {
    Eigen::Vector3d p_w = random.vector(1).normalized() * 6;
    p_w.y() = random.uniform(-3, 3);
    Track track;
    for (std::size_t k = 0; k < scene.T_c_w.size(); ++k) {
      if (random.below(3) == 0) observe(scene, track, random, k, p_w, 20, 0.2, noise);
    }
    if (track.size() >= 3) add_point(scene, p_w, track);
  }
  return scene;
}

/// Moves the free poses and all points off the truth.
inline void perturb(Scene& scene, double sigma_rad, double sigma_m, double sigma_point,
                    std::uint64_t seed = 7) {
  Random random(seed);
  for (std::size_t i = 0; i < scene.T_c_w.size(); ++i) {
    const auto d = random.increment(sigma_rad, sigma_m);
    if (scene.problem.pose_fixed[i] == 0) scene.problem.T_c_w[i] = plus(scene.T_c_w[i], d);
  }
  for (auto& p : scene.problem.points) p += random.vector(sigma_point);
}

/// Observations of one frame of the scene's camera at `T_c_w`, depths 4 to 60 m.
inline std::vector<PoseObservation> make_frame(const Rigid3& T_c_w, int count, double noise,
                                               double mono_share, std::uint64_t seed) {
  Random random(seed);
  const StereoCamera camera = kitti_camera();
  const Rigid3 T_w_c = T_c_w.inverse();
  std::vector<PoseObservation> frame;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p_c = camera.back_project(
        random.uniform(5, camera.width - 5), random.uniform(5, camera.height - 5),
        std::exp(random.uniform(std::log(4.0), std::log(60.0))));
    const Eigen::Vector3d uvr = camera.project_stereo(p_c);
    const double sigma = std::pow(1.2, static_cast<double>(random.below(8)));
    PoseObservation o;
    o.p_w = T_w_c * p_c;
    o.u = static_cast<float>(uvr.x() + random.normal(noise * sigma));
    o.v = static_cast<float>(uvr.y() + random.normal(noise * sigma));
    const auto right = static_cast<float>(o.u - (uvr.x() - uvr.z()) + random.normal(noise * sigma));
    o.u_right = random.uniform(0, 1) < mono_share ? kNoRight : right;
    o.inv_sigma = static_cast<float>(1.0 / sigma);
    frame.push_back(o);
  }
  return frame;
}

}  // namespace kys_slam::test
