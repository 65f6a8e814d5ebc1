// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "map/change_set.h"
#include "retrieval/place_index.h"
#include "support/map_builder.h"

namespace kys_slam::testing {

inline kys::Descriptor random_descriptor(std::mt19937_64& random) {
  kys::Descriptor d;
  for (auto& word : d.words) word = random();
  return d;
}

/// The descriptor with `count` different bits turned over.
inline kys::Descriptor with_flips(kys::Descriptor d, int count, std::mt19937_64& random) {
  std::set<std::uint64_t> bits;
  while (static_cast<int>(bits.size()) < count) bits.insert(random() % 256);
  for (const std::uint64_t bit : bits) d.words[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  return d;
}

/// Features that have these descriptors and nothing else worth mentioning.
inline FrameFeatures features_of(std::vector<kys::Descriptor> descriptors,
                                 std::vector<kys::Prior> priors = {}) {
  FeatureSet set;
  set.keypoints.resize(descriptors.size());
  set.descriptors = std::move(descriptors);
  std::vector<float> u_right(set.size(), kNoStereo);
  return {kitti_camera(), std::move(set), std::move(u_right), std::move(priors)};
}

/// What an index should contain, as plain tables.
struct IndexContent {
  std::map<LandmarkId, LandmarkView> landmarks;
  std::map<KeyFrameId, KeyFrameView> keyframes;

  void see(std::uint32_t landmark, const kys::Descriptor& descriptor,
           std::vector<KeyFrameId> observers) {
    LandmarkView view;
    view.descriptor = descriptor;
    view.observers = std::move(observers);
    landmarks[LandmarkId{landmark}] = view;
  }
  void add_keyframe(std::uint32_t id, std::vector<KeyFrameId> neighbours = {}) {
    keyframes[KeyFrameId{id}].neighbours = std::move(neighbours);
  }

  /// All of it as one change set.
  [[nodiscard]] ChangeSet as_changes() const {
    ChangeSet changes;
    changes.landmarks.assign(landmarks.begin(), landmarks.end());
    changes.keyframes.assign(keyframes.begin(), keyframes.end());
    return changes;
  }
};

struct Answer {
  std::vector<PlaceCandidate> candidates;
  kys::Statistics statistics;
  friend bool operator==(const Answer&, const Answer&) = default;
};

inline Answer ask(const PlaceIndex& index, const FrameFeatures& features,
                  const std::vector<KeyFrameId>& excluded = {}, std::size_t count = 100,
                  const kys::DistanceModel& model = kys::DistanceModel{}) {
  Answer answer;
  answer.candidates = index.query(features, model, answer.statistics, excluded, count);
  return answer;
}

}  // namespace kys_slam::testing
