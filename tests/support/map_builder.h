// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "map/map.h"
#include "support/feature_world.h"

namespace kys_slam::testing {

constexpr KeyFrameId kf(std::uint32_t id) {
  return {id};
}
constexpr LandmarkId lm(std::uint32_t id) {
  return {id};
}

inline constexpr float kNoStereo = std::numeric_limits<float>::quiet_NaN();

/// `count` features anywhere in the image, with random descriptors, octaves and orientations;
/// `stereo_share` of them have a disparity of 2 to 40 px.
inline std::shared_ptr<const FrameFeatures> random_features(const StereoCamera& camera, int count,
                                                            unsigned seed,
                                                            double stereo_share = 0.7) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<float> unit(0, 1);
  FeatureSet set;
  std::vector<float> u_right;
  for (int i = 0; i < count; ++i) {
    Keypoint k;
    k.x = unit(random) * static_cast<float>(camera.width - 1);
    k.y = unit(random) * static_cast<float>(camera.height - 1);
    k.angle = 6.28f * unit(random);
    k.octave = static_cast<std::uint8_t>(random() % 8);
    set.keypoints.push_back(k);
    kys::Descriptor d;
    for (auto& word : d.words) word = random();
    set.descriptors.push_back(d);
    u_right.push_back(unit(random) < stereo_share ? k.x - 2 - 38 * unit(random) : kNoStereo);
  }
  return std::make_shared<const FrameFeatures>(camera, std::move(set), std::move(u_right),
                                               std::vector<kys::Prior>{});
}

inline KeyFrame make_keyframe(std::uint32_t id, std::shared_ptr<const FrameFeatures> features,
                              const Rigid3& T_c_w = {}) {
  KeyFrame keyframe;
  keyframe.id = {id};
  keyframe.frame_index = id;
  keyframe.timestamp = 0.1 * id;
  keyframe.T_c_w = T_c_w;
  keyframe.features = std::move(features);
  return keyframe;
}

inline Landmark make_landmark(std::uint32_t id, const Eigen::Vector3d& p_w,
                              KeyFrameId first = KeyFrameId{0}) {
  Landmark landmark;
  landmark.id = {id};
  landmark.p_w = p_w;
  landmark.first_keyframe = first;
  return landmark;
}

/// The same features, all counted as aligned with their landmarks.
inline std::shared_ptr<const FrameFeatures> all_aligned(const FrameFeatures& features) {
  std::vector<FrameFeatures::Aligned> places;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const RigCorrection::Measured m = features.measured(i);
    places.push_back({static_cast<std::uint32_t>(i), m.u, m.v});
  }
  return std::make_shared<const FrameFeatures>(features.with_aligned(places));
}

/// Exact or noisy features of a FeatureWorld as a keyframe has them, and the point behind each.
struct SeenFeatures {
  std::shared_ptr<const FrameFeatures> features;
  std::vector<std::size_t> points;
};

/// \param rig if given, the cameras measure what a rig that needs this correction measures, rows
/// included
inline SeenFeatures see(const FeatureWorld& world, std::int64_t index, const Rigid3& T_w_c,
                        bool with_stereo = true, const RigCorrection* rig = nullptr) {
  SeenFeatures seen;
  StereoFrame frame = world.look(index, T_w_c, &seen.points);
  RightPositions right;
  for (std::size_t i = 0; i < frame.right_features->size(); ++i) {
    const float u = frame.right_features->keypoints[i].x;
    right.u.push_back(with_stereo ? u : kNoStereo);
    if (rig == nullptr) continue;
    Keypoint& k = frame.left_features->keypoints[i];
    const Eigen::Vector2f at = rig->measured_right(k.x, k.y, u).cast<float>();
    if (with_stereo) right.u.back() = at.x();
    right.v.push_back(at.y());
    const Eigen::Vector2f left = rig->measured_left(k.x, k.y).cast<float>();
    k.x = left.x();
    k.y = left.y();
  }
  seen.features = std::make_shared<const FrameFeatures>(
      world.camera(), std::move(*frame.left_features), std::move(right), std::vector<kys::Prior>{});
  return seen;
}

/// A map of a FeatureWorld seen from `poses` (T_w_c): every point seen by at least two keyframes is
/// a landmark (its id: its number in the world) at its true place, with all its observations.
struct WorldMap {
  Map map;
  std::vector<SeenFeatures> seen;  // by keyframe
};

/// \param disparity_error px, contained in every measured disparity
/// \param wanted which points become landmarks; null: all
/// \param rig as for see()
inline WorldMap map_of_world(const FeatureWorld& world, const std::vector<Rigid3>& poses,
                             float disparity_error = 0, bool with_stereo = true,
                             bool (*wanted)(std::size_t point) = nullptr,
                             const RigCorrection* rig = nullptr) {
  WorldMap result{Map(world.camera(), ScaleLevels(1.2, 8)), {}};
  std::vector<int> views(world.points().size(), 0);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    SeenFeatures seen = see(world, static_cast<std::int64_t>(k), poses[k], with_stereo, rig);
    if (disparity_error != 0) {
      // A bias of the measurement, unknown to the features themselves.
      FeatureSet set{{seen.features->keypoints().begin(), seen.features->keypoints().end()},
                     {seen.features->descriptors().begin(), seen.features->descriptors().end()}};
      std::vector<float> u_right;
      for (std::size_t i = 0; i < set.size(); ++i) {
        u_right.push_back(seen.features->u_right(i) - disparity_error);
      }
      seen.features = std::make_shared<const FrameFeatures>(
          world.camera(), std::move(set), std::move(u_right), std::vector<kys::Prior>{});
    }
    if (world.aligned()) seen.features = all_aligned(*seen.features);
    for (const std::size_t p : seen.points) ++views[p];
    result.map.add_keyframe(
        make_keyframe(static_cast<std::uint32_t>(k), seen.features, poses[k].inverse()));
    result.seen.push_back(std::move(seen));
  }
  for (std::size_t p = 0; p < views.size(); ++p) {
    if (views[p] >= 2 && (wanted == nullptr || wanted(p))) {
      result.map.add_landmark(make_landmark(static_cast<std::uint32_t>(p), world.points()[p].p_w));
    }
  }
  for (std::size_t k = 0; k < result.seen.size(); ++k) {
    const KeyFrameId id{static_cast<std::uint32_t>(k)};
    for (std::size_t f = 0; f < result.seen[k].points.size(); ++f) {
      const LandmarkId landmark{static_cast<std::uint32_t>(result.seen[k].points[f])};
      if (result.map.has(landmark)) {
        result.map.add_observation(landmark, id, static_cast<std::uint32_t>(f));
      }
    }
    if (k > 0) {
      result.map.connect_to_spanning_tree(id, KeyFrameId{static_cast<std::uint32_t>(k - 1)});
    }
  }
  for (const LandmarkId id : result.map.landmarks().ids()) result.map.refresh_landmark(id);
  return result;
}

}  // namespace kys_slam::testing
