// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

namespace kys_slam::testing {

/// A street-like corridor with walls and a floor of coloured blocks of many sizes, rendered with
/// exact geometry: stereo images whose true poses and depths are known. Everything follows from the
/// seed.
class RenderedCorridor {
 public:
  RenderedCorridor(const StereoCamera& camera, unsigned seed, double noise_sigma = 1.5)
      : camera_(camera), seed_(seed), noise_sigma_(noise_sigma) {}

  [[nodiscard]] const StereoCamera& camera() const { return camera_; }

  [[nodiscard]] StereoFrame look(std::int64_t index, const Rigid3& T_w_c) const {
    StereoFrame frame;
    frame.index = index;
    frame.timestamp = 0.1 * static_cast<double>(index);
    frame.left = render(T_w_c, 2 * index);
    const Rigid3 T_c_r(Eigen::Quaterniond::Identity(), {camera_.baseline, 0, 0});
    frame.right = render(T_w_c * T_c_r, 2 * index + 1);
    return frame;
  }

  /// m along the optical axis of the left camera at a pixel.
  [[nodiscard]] double depth(const Rigid3& T_w_c, double u, double v) const {
    const Eigen::Vector3d ray = camera_.back_project(u, v, 1);
    return hit(T_w_c.t(), T_w_c.rotation * ray).distance;
  }

 private:
  static constexpr double kHalfWidth = 7;  // m, walls at x = +-7
  static constexpr double kFloor = 1.7;    // m below the camera
  static constexpr double kRoof = -6;      // m: above it the sky, a far dome

  struct Hit {
    double distance;  // in units of the ray
    double s, t;      // m on the surface
    int surface;
  };

  static Hit hit(const Eigen::Vector3d& o, const Eigen::Vector3d& d) {
    Hit best{1e9, 0, 0, 0};
    const auto consider = [&](double distance, int surface) {
      if (distance > 0 && distance < best.distance) best = {distance, 0, 0, surface};
    };
    if (d.x() > 1e-9) consider((kHalfWidth - o.x()) / d.x(), 1);
    if (d.x() < -1e-9) consider((-kHalfWidth - o.x()) / d.x(), 2);
    if (d.y() > 1e-9) consider((kFloor - o.y()) / d.y(), 3);
    // Buttresses every 12 m give the walls depth.
    for (int side = -1; side <= 1; side += 2) {
      const double x = side * (kHalfWidth - 1.5);
      if (side * d.x() > 1e-9) {
        const double distance = (x - o.x()) / d.x();
        const double z = o.z() + distance * d.z();
        if (z - 12 * std::floor(z / 12) < 4) consider(distance, side > 0 ? 4 : 5);
      }
    }
    if (d.z() > 1e-9) {
      const double first = 12 * std::floor(o.z() / 12) + 12;
      for (int k = 0; k < 8; ++k) {
        const double distance = (first + 12 * k - o.z()) / d.z();
        const double x = std::abs(o.x() + distance * d.x());
        if (x > kHalfWidth - 1.5 && x < kHalfWidth) consider(distance, 6);
      }
      consider((o.z() + 300 - o.z()) / d.z(), 7);
    }
    const Eigen::Vector3d p = o + best.distance * d;
    if (best.surface != 7 && p.y() < kRoof) {
      // Over the walls: a dome at infinity, dressed by direction alone.
      const Eigen::Vector3d n = d.normalized();
      return {1e6, 40 * n.x(), 40 * n.y(), 8};
    }
    switch (best.surface) {
      case 3:
        best.s = p.x(), best.t = p.z();
        break;
      case 6:
      case 7:
        best.s = p.x(), best.t = p.y() + 100 * best.surface + std::round(p.z());
        break;
      default:
        best.s = p.z(), best.t = p.y();
        break;
    }
    return best;
  }

  [[nodiscard]] std::uint64_t hash(std::int64_t a, std::int64_t b, int c, int d) const {
    std::uint64_t h = seed_ + 0x9E3779B97F4A7C15ull * static_cast<std::uint64_t>(a + 1000003);
    h ^= 0xBF58476D1CE4E5B9ull * static_cast<std::uint64_t>(b + 7777777);
    h ^= 0x94D049BB133111EBull * static_cast<std::uint64_t>(31 * c + d + 1);
    h ^= h >> 29;
    h *= 0xD6E8FEB86659FD93ull;
    h ^= h >> 32;
    h *= 0xD6E8FEB86659FD93ull;
    return h ^ (h >> 32);
  }

  [[nodiscard]] double grey(const Hit& hit, double footprint) const {
    double value = 128;
    double size = 0.06;
    for (int octave = 0; octave < 7; ++octave, size *= 2) {
      // Blocks smaller than a pixel would flicker: they fade out.
      const double weight = std::clamp(size / footprint - 1, 0.0, 1.0);
      if (weight <= 0) continue;
      const auto a = static_cast<std::int64_t>(std::floor(hit.s / size));
      const auto b = static_cast<std::int64_t>(std::floor(hit.t / size));
      const double unit = static_cast<double>(hash(a, b, hit.surface, octave) >> 11) * 0x1p-53;
      value += weight * 60 * (unit - 0.5);
    }
    return value;
  }

  [[nodiscard]] GrayImage render(const Rigid3& T_w_c, std::int64_t stream) const {
    constexpr int kSamples = 3;
    GrayImage image(camera_.width, camera_.height);
    std::mt19937_64 random(seed_ * 7919u + static_cast<std::uint64_t>(stream));
    std::normal_distribution<double> noise(0, noise_sigma_);
    const Eigen::Matrix3d R = T_w_c.R();
    for (int y = 0; y < camera_.height; ++y) {
      for (int x = 0; x < camera_.width; ++x) {
        double sum = 0;
        for (int k = 0; k < kSamples * kSamples; ++k) {
          const double u = x + (k % kSamples + 0.5) / kSamples - 0.5;
          const double v = y + (k / kSamples + 0.5) / kSamples - 0.5;
          const Hit h = hit(T_w_c.t(), R * camera_.back_project(u, v, 1));
          sum += grey(h, h.distance / camera_.fx);
        }
        const double value = sum / (kSamples * kSamples) + (noise_sigma_ > 0 ? noise(random) : 0);
        image.at(x, y) = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0l, 255l));
      }
    }
    return image;
  }

  StereoCamera camera_;
  unsigned seed_;
  double noise_sigma_;
};

}  // namespace kys_slam::testing
