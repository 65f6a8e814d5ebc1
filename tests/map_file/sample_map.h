// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/prior.h>

#include <random>
#include <utility>
#include <vector>

#include "map/map.h"
#include "support/map_builder.h"

namespace kys_slam::testing {

inline constexpr const char* kSampleLabelSpace = "cityscapes19";

/// Features with a prior each, some of them without a label.
inline std::shared_ptr<const FrameFeatures> features_with_priors(const StereoCamera& camera,
                                                                 int count, unsigned seed) {
  const auto plain = random_features(camera, count, seed);
  std::mt19937 random(seed);
  std::vector<kys::Prior> priors;
  std::vector<float> u_right;
  for (std::size_t i = 0; i < plain->size(); ++i) {
    const auto label = static_cast<std::uint16_t>(random() % 19);
    priors.push_back(random() % 4 == 0
                         ? kys::Prior{}
                         : kys::make_prior(label, static_cast<int>(random() % 1000), 100.0f * label,
                                           0.25f * label, random() % 5 == 0));
    u_right.push_back(plain->u_right(i));
  }
  return std::make_shared<const FrameFeatures>(
      camera,
      FeatureSet{{plain->keypoints().begin(), plain->keypoints().end()},
                 {plain->descriptors().begin(), plain->descriptors().end()}},
      std::move(u_right), std::move(priors));
}

/// A map with everything a map can have: `keyframes` keyframes (at least 6, the last two a sub-map
/// of their own) of `features` features, culled ones (one hanging on another), a replaced landmark,
/// loop edges, priors, an offset.
inline Map sample_map(std::uint32_t keyframes = 8, int features = 60, bool with_priors = true) {
  Map map(kitti_camera(), ScaleLevels(1.2, 8));
  for (std::uint32_t k = 0; k < keyframes; ++k) {
    KeyFrame keyframe = make_keyframe(
        k,
        with_priors ? features_with_priors(map.camera(), features, k + 1)
                    : random_features(map.camera(), features, k + 1),
        Rigid3(so3_exp({0.01 * k, 0.1 * k, 0}), Eigen::Vector3d(0.1, 0.2 * k, -1.5 * k)));
    keyframe.frame_index = 7 * k;
    map.add_keyframe(std::move(keyframe));
  }
  std::mt19937 random(5);
  const std::uint32_t second = keyframes - 2;
  for (std::uint32_t l = 0; l < static_cast<std::uint32_t>(features); ++l) {
    const bool in_second = l % 5 == 4;
    const std::uint32_t first = in_second ? second : random() % (keyframes - 5);
    map.add_landmark(make_landmark(2 * l, {0.1 * l, 1.0 / (l + 1), 20.0 + l}, {first}));
    for (std::uint32_t k = first; k < (in_second ? keyframes : first + 4); ++k) {
      map.add_observation({2 * l}, {k}, l);
    }
    map.add_visible({2 * l}, l, l / 2);
    map.refresh_landmark({2 * l});
  }
  for (std::uint32_t k = 1; k < keyframes; ++k) {
    if (k != second) map.connect_to_spanning_tree({k}, {k - 1});
  }
  map.add_loop_edge({0}, {1});
  map.add_loop_edge({0}, {second - 1});
  map.cull_keyframe({3});
  map.cull_keyframe({2});
  map.replace_landmark({2}, {0});
  RigEstimate rig(RigCorrection::of_offset(map.camera(), 0.0625));
  rig.covariance(12, 12) = 0.25;
  map.set_rig(rig);
  return map;
}

}  // namespace kys_slam::testing
