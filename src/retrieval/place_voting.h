// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "map/id_table.h"
#include "map/ids.h"
#include "retrieval/place_candidate.h"

namespace kys_slam {

/// The votes of one query: the allowed keyframes and their votes.
class PlaceVotes {
 public:
  using Neighbours = IdTable<KeyFrameId, std::vector<KeyFrameId>>;

  /// \param landmark_count landmarks observed, by keyframe id; must outlive this object
  explicit PlaceVotes(const std::vector<std::uint32_t>& landmark_count)
      : landmark_count_(landmark_count),
        allowed_(landmark_count.size(), 0),
        votes_(landmark_count.size(), 0),
        weight_(landmark_count.size(), 0),
        voted_(landmark_count.size(), 0) {}

  /// Allows votes for `keyframes` except `excluded`.
  void allow(std::span<const KeyFrameId> keyframes, std::span<const KeyFrameId> excluded);

  [[nodiscard]] bool is_allowed(std::uint32_t keyframe) const {
    return keyframe < allowed_.size() && allowed_[keyframe] != 0;
  }
  [[nodiscard]] bool any_allowed(std::span<const std::uint32_t> keyframes) const {
    for (const std::uint32_t keyframe : keyframes) {
      if (is_allowed(keyframe)) return true;
    }
    return false;
  }

  /// A feature votes once for each keyframe given to `add` between these two calls, with the
  /// closeness of its first occurrence.
  void begin_feature();
  void add(std::span<const std::uint32_t> keyframes, double closeness);
  void end_feature();

  /// The result as PlaceIndex::query describes it.
  [[nodiscard]] std::vector<PlaceCandidate> candidates(const Neighbours& neighbours,
                                                       std::size_t max_candidates) const;

 private:
  [[nodiscard]] double density(double weight, double landmarks) const;

  const std::vector<std::uint32_t>& landmark_count_;
  // By keyframe id.
  std::vector<std::uint8_t> allowed_;
  std::vector<int> votes_;
  std::vector<double> weight_;        // of the votes
  std::vector<std::uint32_t> voted_;  // the last feature that voted for it
  std::size_t allowed_count_ = 0;
  double allowed_landmarks_ = 0;  // sum over the allowed keyframes
  std::uint32_t feature_ = 0;
  std::vector<std::pair<std::uint32_t, double>> voted_for_;  // by this feature, and how closely
};

}  // namespace kys_slam
