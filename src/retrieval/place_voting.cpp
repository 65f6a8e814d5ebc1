// SPDX-License-Identifier: BSD-3-Clause
#include "retrieval/place_voting.h"

#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {

void PlaceVotes::allow(std::span<const KeyFrameId> keyframes,
                       std::span<const KeyFrameId> excluded) {
  for (const KeyFrameId id : keyframes) {
    if (id.value < allowed_.size()) allowed_[id.value] = 1;
  }
  for (const KeyFrameId id : excluded) {
    if (id.value < allowed_.size()) allowed_[id.value] = 0;
  }
  for (std::size_t k = 0; k < allowed_.size(); ++k) {
    if (allowed_[k] == 0) continue;
    ++allowed_count_;
    allowed_landmarks_ += landmark_count_[k];
  }
}

void PlaceVotes::begin_feature() {
  ++feature_;
  voted_for_.clear();
}

void PlaceVotes::add(std::span<const std::uint32_t> keyframes, double closeness) {
  for (const std::uint32_t keyframe : keyframes) {
    if (!is_allowed(keyframe) || voted_[keyframe] == feature_) continue;
    voted_[keyframe] = feature_;
    voted_for_.emplace_back(keyframe, closeness);
  }
}

void PlaceVotes::end_feature() {
  if (voted_for_.empty()) return;
  // What is seen everywhere tells nothing about where one is (inverse document frequency).
  const double rarity = kys::portable::log1p(static_cast<double>(allowed_count_) /
                                             static_cast<double>(voted_for_.size()));
  for (const auto& [keyframe, closeness] : voted_for_) {
    ++votes_[keyframe];
    weight_[keyframe] += closeness * rarity;
  }
}

double PlaceVotes::density(double weight, double landmarks) const {
  // A keyframe of few landmarks may get a high share of them by chance: as if each had as many
  // more as one has on average, without votes.
  const double typical = allowed_landmarks_ / static_cast<double>(allowed_count_);
  return weight / (landmarks + typical);
}

/// A place is a group of covisible keyframes: they observe the same landmarks, share the votes, and
/// none leads clearly. Votes are summed over the group, and only its best member is a candidate, or
/// all first ranks would be of one place.
std::vector<PlaceCandidate> PlaceVotes::candidates(const Neighbours& neighbours,
                                                   std::size_t max_candidates) const {
  std::vector<double> own(votes_.size(), 0);
  std::vector<double> best(votes_.size(), 0);  // of the groups a keyframe is the best member of
  for (std::size_t k = 0; k < own.size(); ++k) {
    if (votes_[k] > 0) own[k] = density(weight_[k], landmark_count_[k]);
  }
  for (std::size_t k = 0; k < own.size(); ++k) {
    if (votes_[k] == 0) continue;
    double weight = weight_[k];
    double landmarks = landmark_count_[k];
    std::size_t leader = k;
    for (const KeyFrameId other : neighbours.at(KeyFrameId{static_cast<std::uint32_t>(k)})) {
      if (!is_allowed(other.value)) continue;
      const std::size_t o = other.value;
      weight += weight_[o];
      landmarks += landmark_count_[o];
      if (own[o] > own[leader] || (own[o] == own[leader] && o < leader)) leader = o;
    }
    best[leader] = std::max(best[leader], density(weight, landmarks));
  }
  std::vector<PlaceCandidate> result;
  for (std::size_t k = 0; k < best.size(); ++k) {
    if (best[k] > 0) {
      result.push_back({KeyFrameId{static_cast<std::uint32_t>(k)}, best[k], votes_[k]});
    }
  }
  const std::size_t count = std::min(max_candidates, result.size());
  std::partial_sort(result.begin(), result.begin() + static_cast<std::ptrdiff_t>(count),
                    result.end(), [](const PlaceCandidate& a, const PlaceCandidate& b) {
                      return a.score != b.score ? a.score > b.score : a.keyframe < b.keyframe;
                    });
  result.resize(count);
  return result;
}

}  // namespace kys_slam
