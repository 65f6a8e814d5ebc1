// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/association.h"

#include <dlib/matrix.h>
#include <dlib/optimization/max_cost_assignment.h>
#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

namespace kys_slam {

void check_assignment(std::size_t things, std::size_t tracks) {
  constexpr std::size_t kMost = 2048;
  constexpr std::size_t kBytesPerPair = 16;
  const std::size_t n = std::max(things, tracks);
  if (n > kMost) {
    throw InputError("more than " + std::to_string(kMost) +
                     " things to tell apart: " + std::to_string(things) + " in the frame, " +
                     std::to_string(tracks) + " of the frames before");
  }
  check_memory("identities of things", kBytesPerPair * n * n);
}

void InstanceAssociator::assign(std::span<const Detection> detections,
                                const std::vector<std::size_t>& detection_ids,
                                const std::vector<std::size_t>& track_ids,
                                std::vector<std::int32_t>& track_of) const {
  if (detection_ids.empty() || track_ids.empty()) return;
  check_assignment(detection_ids.size(), track_ids.size());
  const auto n = static_cast<long>(std::max(detection_ids.size(), track_ids.size()));
  // The library wants integers (1/1024 px) and the largest sum. Rows and columns that fill up the
  // square have gain 0, less than any pair, so that as many pairs as possible are made.
  dlib::matrix<std::int64_t> gain(n, n);
  gain = 0;
  std::int64_t largest = 0;
  std::vector<std::int64_t> cost(detection_ids.size() * track_ids.size());
  const auto distance = [&](std::size_t d, std::size_t t) {
    const Detection& detection = detections[detection_ids[d]];
    const Track& track = tracks_[track_ids[t]];
    return std::hypot(detection.u - track.u, detection.v - track.v);
  };
  for (std::size_t d = 0; d < detection_ids.size(); ++d) {
    for (std::size_t t = 0; t < track_ids.size(); ++t) {
      cost[d * track_ids.size() + t] = std::llround(1024.0 * distance(d, t));
      largest = std::max(largest, cost[d * track_ids.size() + t]);
    }
  }
  for (std::size_t d = 0; d < detection_ids.size(); ++d) {
    for (std::size_t t = 0; t < track_ids.size(); ++t) {
      gain(static_cast<long>(d), static_cast<long>(t)) =
          largest + 1 - cost[d * track_ids.size() + t];
    }
  }
  const std::vector<long> column = dlib::max_cost_assignment(gain);
  for (std::size_t d = 0; d < detection_ids.size(); ++d) {
    const auto t = static_cast<std::size_t>(column[d]);
    if (t < track_ids.size() && distance(d, t) <= options_.max_distance) {
      track_of[detection_ids[d]] = static_cast<std::int32_t>(track_ids[t]);
    }
  }
}

std::vector<std::int32_t> InstanceAssociator::next_frame(std::span<const Detection> detections) {
  std::map<int, std::pair<std::vector<std::size_t>, std::vector<std::size_t>>> groups;
  const auto group_of = [this](std::uint16_t label) { return options_.class_agnostic ? 0 : label; };
  for (std::size_t d = 0; d < detections.size(); ++d) {
    groups[group_of(detections[d].label)].first.push_back(d);
  }
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    groups[group_of(tracks_[t].label)].second.push_back(t);
  }
  std::vector<std::int32_t> track_of(detections.size(), -1);
  for (const auto& [label, group] : groups) {
    assign(detections, group.first, group.second, track_of);
  }

  for (Track& track : tracks_) ++track.missed;
  std::vector<std::int32_t> identities(detections.size());
  for (std::size_t d = 0; d < detections.size(); ++d) {
    const Detection& detection = detections[d];
    if (track_of[d] < 0) {
      tracks_.push_back({next_identity_, detection.label, detection.u, detection.v, 0});
      identities[d] = next_identity_++;
      continue;
    }
    Track& track = tracks_[static_cast<std::size_t>(track_of[d])];
    track = {track.identity, detection.label, detection.u, detection.v, 0};
    identities[d] = track.identity;
  }
  std::erase_if(tracks_,
                [this](const Track& track) { return track.missed > options_.max_missed_frames; });
  return identities;
}

}  // namespace kys_slam
