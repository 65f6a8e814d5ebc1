// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>

#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam::testing {

/// A world of points with descriptors, and what a stereo camera sees of it: features without
/// images, exact or with noise. Everything follows from the seed.
class FeatureWorld {
 public:
  struct Options {
    int points = 4000;
    double length = 60;      ///< m along z
    double half_width = 12;  ///< m
    double half_height = 4;  ///< m
    double pixel_noise = 0;  ///< px at octave 0, standard deviation
    /// corners count as aligned with their landmarks; noise has the ratio of images then
    bool aligned = false;
    int flipped_bits = 0;      ///< of each descriptor, at random
    double max_distance = 60;  ///< m
    int max_features = 1500;
    unsigned seed = 1;
  };

  struct Point {
    Eigen::Vector3d p_w;
    kys::Descriptor descriptor;
    double largest_distance;  ///< m, where it is seen on octave 0
    float angle;
  };

  FeatureWorld(const StereoCamera& camera, const Options& options)
      : camera_(camera), options_(options) {
    std::mt19937_64 random(options.seed);
    std::uniform_real_distribution<double> unit(-1, 1);
    for (int i = 0; i < options.points; ++i) {
      Point point;
      point.p_w = {options.half_width * unit(random), options.half_height * unit(random),
                   0.5 * options.length * (1 + unit(random))};
      // Nothing inside the corridor the camera moves in.
      if (std::abs(point.p_w.x()) < 1.5 && std::abs(point.p_w.y()) < 1.5) continue;
      for (auto& word : point.descriptor.words) word = random();
      point.largest_distance = 25 * (1.5 + unit(random));
      point.angle = static_cast<float>(3.1 * (1 + unit(random)));
      points_.push_back(point);
    }
  }

  /// A world of given points.
  FeatureWorld(const StereoCamera& camera, const Options& options, std::vector<Point> points)
      : camera_(camera), options_(options), points_(std::move(points)) {}

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }
  [[nodiscard]] const std::vector<Point>& points() const { return points_; }
  [[nodiscard]] bool aligned() const { return options_.aligned; }

  /// Frame number `index` seen from T_w_c. `seen`, if given, receives the point of every feature.
  [[nodiscard]] StereoFrame look(std::int64_t index, const Rigid3& T_w_c,
                                 std::vector<std::size_t>* seen = nullptr) const {
    std::mt19937_64 random(options_.seed * 1000003u + static_cast<unsigned>(index));
    std::normal_distribution<float> noise(0, static_cast<float>(options_.pixel_noise));
    const InformationRatio information = options_.aligned ? kImageInformation : InformationRatio{};
    const float part_v = 1 / std::sqrt(information.v);
    const float part_disparity = 1 / std::sqrt(information.disparity);
    StereoFrame frame;
    frame.index = index;
    frame.timestamp = 0.1 * static_cast<double>(index);
    frame.left_features.emplace();
    frame.right_features.emplace();
    const Rigid3 T_c_w = T_w_c.inverse();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (static_cast<int>(frame.left_features->size()) >= options_.max_features) break;
      const Eigen::Vector3d p_c = T_c_w * points_[i].p_w;
      if (p_c.z() < 1 || p_c.norm() > options_.max_distance) continue;
      const Eigen::Vector3d pixel = camera_.project_stereo(p_c);
      if (!camera_.in_image(pixel.x(), pixel.y()) || pixel.z() < 0) continue;
      const double ratio = points_[i].largest_distance / p_c.norm();
      const int octave =
          ratio > 1 ? static_cast<int>(std::ceil(std::log(ratio) / std::log(1.2))) : 0;
      if (octave > 7) continue;
      Keypoint k;
      k.octave = static_cast<std::uint8_t>(octave);
      const auto sigma = static_cast<float>(std::pow(1.2, octave));
      k.angle = points_[i].angle;
      k.response = 30;
      k.x = static_cast<float>(pixel.x()) + sigma * noise(random);
      k.y = static_cast<float>(pixel.y()) + part_v * sigma * noise(random);
      frame.left_features->keypoints.push_back(k);
      frame.left_features->descriptors.push_back(noisy(points_[i].descriptor, random));
      // As stereo matching does: the disparity is that of where the left keypoint lies.
      k.x += static_cast<float>(pixel.z() - pixel.x()) + part_disparity * sigma * noise(random);
      frame.right_features->keypoints.push_back(k);
      frame.right_features->descriptors.push_back(noisy(points_[i].descriptor, random));
      if (seen != nullptr) seen->push_back(i);
    }
    return frame;
  }

 private:
  [[nodiscard]] kys::Descriptor noisy(kys::Descriptor d, std::mt19937_64& random) const {
    for (int k = 0; k < options_.flipped_bits; ++k) {
      const std::uint64_t bit = random() % 256;
      d.words[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    }
    return d;
  }

  StereoCamera camera_;
  Options options_;
  std::vector<Point> points_;
};

/// A camera like that of KITTI 00.
inline StereoCamera kitti_camera() {
  return {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.53716};
}

/// A drive along z with a gentle weave.
inline Rigid3 weaving_pose(double metres) {
  const double s = metres / 10;
  return {so3_exp({0.01 * std::sin(s), 0.05 * std::sin(0.7 * s), 0}),
          Eigen::Vector3d(0.5 * std::sin(s), 0.1 * std::sin(2 * s), metres)};
}

/// `frames` poses of that drive, `step` m apart.
inline std::vector<Rigid3> weaving_poses(int frames, double step) {
  std::vector<Rigid3> poses;
  for (int i = 0; i < frames; ++i) poses.push_back(weaving_pose(step * i));
  return poses;
}

/// A round road of radius `kRingRadius` (m) in the plane y = 0, with points on both sides of it,
/// and the inner side too far across to be seen from the other half.
inline constexpr double kRingRadius = 40;

inline FeatureWorld ring_world(FeatureWorld::Options options) {
  std::mt19937_64 random(options.seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<FeatureWorld::Point> points;
  options.max_distance = 30;
  for (int i = 0; i < options.points; ++i) {
    const double angle = 3.14159265358979 * (1 + unit(random));
    double across = 12 * unit(random);
    if (std::abs(across) < 2) across += across < 0 ? -2 : 2;
    FeatureWorld::Point point;
    point.p_w = {(kRingRadius + across) * std::cos(angle), 3 * unit(random),
                 (kRingRadius + across) * std::sin(angle)};
    for (auto& word : point.descriptor.words) word = random();
    point.largest_distance = 15 * (1.5 + unit(random));
    point.angle = static_cast<float>(3.1 * (1 + unit(random)));
    points.push_back(point);
  }
  return {kitti_camera(), options, std::move(points)};
}

/// T_w_c on the round road, looking ahead, `metres` along it.
inline Rigid3 ring_pose(double metres) {
  const double angle = metres / kRingRadius;
  // Forward (z of the camera) is the tangent, right (x) points outwards or inwards.
  const Eigen::Vector3d z(-std::sin(angle), 0, std::cos(angle));
  const Eigen::Vector3d y(0, 1, 0);
  Eigen::Matrix3d R;
  R.col(0) = y.cross(z);
  R.col(1) = y;
  R.col(2) = z;
  return {Eigen::Quaterniond(R),
          Eigen::Vector3d(kRingRadius * std::cos(angle), 0, kRingRadius * std::sin(angle))};
}
inline double ring_length() {
  return 2 * 3.14159265358979 * kRingRadius;
}

}  // namespace kys_slam::testing
