// SPDX-License-Identifier: BSD-3-Clause
#include "motion/object_tracks.h"

#include <kys_slam/check_options.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>

#include "motion/object_assignment.h"
#include "motion/object_filter.h"

namespace kys_slam {

void describe(kys::OptionList& list, ObjectTrackOptions& o) {
  list.add("objects.acceleration_density", o.acceleration_density, {1e-6, 1e6}, "m^2/s^3",
           "of the white acceleration of the motion model");
  list.add("objects.start_speed", o.start_speed, {0.01, 1000}, "m/s",
           "standard deviation of the initial velocity");
  list.add("objects.surface_sigma", o.surface_sigma, {0.001, 100}, "m",
           "standard deviation of the centre of the visible part");
  list.add("objects.speed_sigma", o.speed_sigma, {0.0001, 100}, "m/s",
           "standard deviation added to every observed velocity");
  list.add("objects.gate", o.gate, {0.01, 1000}, "m",
           "largest distance of an observation from its prediction");
  list.add("objects.gate_growth", o.gate_growth, {0, 1000}, "m/s",
           "growth of the gate without observations");
  list.add("objects.restart_gate", o.restart_gate, {0, 1000}, "m",
           "gate for an observation of the same instance; its filter restarts");
  list.add("objects.restart_observations", o.restart_observations, {1, 1000}, "",
           "of the same instance one after the other outside of the gate, from which it restarts; "
           "fewer are passed over");
  list.add("objects.restart_share", o.restart_share, {0, 1}, "",
           "share of the keypoints per frame below which a short part before or after a restart "
           "takes the motion of the other part");
  list.add("objects.max_gap", o.max_gap, {0.001, 1000}, "s",
           "without an observation after which a track ends");
  list.add("objects.max_extrapolation", o.max_extrapolation, {0, 1000}, "s",
           "before the first and after the last observation of the position of an object");
  list.add("objects.min_observations", o.min_observations, {1, 1000000}, "",
           "observations below which a track is dropped");
}
namespace {

using namespace objects;

/// What is used for the motion of a track.
struct Support {
  double begin = 0, end = 0;  // s
  double keypoints = 0;       // per frame
};

const ObjectObservation& observation(std::span<const ObjectFrame> frames, const Seen& seen) {
  return frames[seen.frame].observations[seen.observation];
}

bool is_placed(std::span<const ObjectFrame> frames, const Seen& seen) {
  return seen.used && observation(frames, seen).place.has_value();
}

Support support_of(std::span<const ObjectFrame> frames, const Track& track) {
  Support support;
  int count = 0;
  for (const Seen& seen : track.seen) {
    if (!is_placed(frames, seen)) continue;
    if (count++ == 0) support.begin = frames[seen.frame].taken;
    support.end = frames[seen.frame].taken;
    support.keypoints += observation(frames, seen).keypoints;
  }
  support.keypoints /= count;
  return support;
}

/// Of two parts of a track, before and after a restart, the one that is short and has few
/// keypoints; null: none.
Track* poor_part(std::span<const ObjectFrame> frames, const ObjectTrackOptions& options,
                 Track& first, Track& second) {
  const Support before = support_of(frames, first);
  const Support after = support_of(frames, second);
  if (after.begin - before.end > options.max_gap) return nullptr;
  const auto is_poor = [&](const Support& part, const Support& other) {
    return part.keypoints < options.restart_share * other.keypoints &&
           part.end - part.begin <= options.max_extrapolation;
  };
  if (is_poor(before, after)) return &first;
  return is_poor(after, before) ? &second : nullptr;
}

/// An object that is observed too far from its expected position has a new identity. It keeps the
/// old one when one of the two parts is poor: that part was wrong, and the identity in the priors
/// is right.
void keep_names(std::span<const ObjectFrame> frames, const ObjectTrackOptions& options,
                std::vector<Track>& tracks) {
  for (Track& next : tracks) {
    const std::int32_t name = observation(frames, next.seen.front()).instance;
    if (next.identity == name) continue;
    for (Track& before : tracks) {
      if (before.identity != name || before.seen.back().frame >= next.seen.front().frame) continue;
      if (poor_part(frames, options, before, next) != nullptr) next.identity = name;
    }
  }
}

/// Joins the parts of a track before and after a restart where one of them is poor: that part keeps
/// its frames and takes the motion of the other.
void join_restarts(std::span<const ObjectFrame> frames, const ObjectTrackOptions& options,
                   std::vector<Track>& tracks) {
  std::stable_sort(tracks.begin(), tracks.end(), [](const Track& a, const Track& b) {
    return std::tie(a.identity, a.seen.front().frame) < std::tie(b.identity, b.seen.front().frame);
  });
  std::vector<Track> joined;
  for (Track& next : tracks) {
    const bool continues = !joined.empty() && joined.back().identity == next.identity;
    Track* poor = continues ? poor_part(frames, options, joined.back(), next) : nullptr;
    if (poor == nullptr) {
      joined.push_back(std::move(next));
      continue;
    }
    for (Seen& seen : poor->seen) seen.used = false;
    joined.back().seen.insert(joined.back().seen.end(), next.seen.begin(), next.seen.end());
  }
  tracks = std::move(joined);
}

/// Drops what is seen of a track too long before or after its observations of the position, and
/// what is unlikely to move at its ends. \param goes_on  it has another part, soon after a restart
void trim(std::span<const ObjectFrame> frames, const ObjectTrackOptions& options, bool goes_on,
          Track& track) {
  const auto time = [&](const Seen& seen) { return frames[seen.frame].taken; };
  const auto placed = [&](const Seen& seen) { return is_placed(frames, seen); };
  const auto first = std::find_if(track.seen.begin(), track.seen.end(), placed);
  const auto last = std::find_if(track.seen.rbegin(), track.seen.rend(), placed);
  const double begin = time(*first) - options.max_extrapolation;
  const double end = time(*last) + options.max_extrapolation;
  std::erase_if(track.seen, [&](const Seen& s) { return time(s) < begin || time(s) > end; });
  const auto likely = [&](const Seen& s) { return !observation(frames, s).unlikely; };
  track.seen.erase(track.seen.begin(), std::find_if(track.seen.begin(), track.seen.end(), likely));
  if (goes_on) return;
  track.seen.erase(std::find_if(track.seen.rbegin(), track.seen.rend(), likely).base(),
                   track.seen.end());
}

TrackData data_of(std::span<const ObjectFrame> frames, const Track& track,
                  const ObjectTrackOptions& options) {
  const std::size_t count = track.seen.size();
  const auto time = [&](std::size_t i) { return frames[track.seen[i].frame].taken; };
  TrackData data;
  for (std::size_t i = 0; i < count; ++i) data.times.push_back(time(i));
  data.velocities.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const ObjectFrame& frame = frames[track.seen[i].frame];
    const auto& velocity = observation(frames, track.seen[i]).velocity;
    if (!velocity || !track.seen[i].used) continue;
    const double middle = frame.taken - velocity->span / 2;
    std::size_t at = i;
    while (at > 0 && std::abs(time(at - 1) - middle) <= std::abs(time(at) - middle)) --at;
    data.velocities[at].push_back(world_velocity(frame, *velocity, options));
  }
  data.places.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Seen& seen = track.seen[i];
    if (!is_placed(frames, seen)) continue;
    data.places[i] = world_place(frames[seen.frame], *observation(frames, seen).place, options);
  }
  return data;
}

}  // namespace

std::vector<ObjectEstimate> track_objects(std::span<const ObjectFrame> frames,
                                          const ObjectTrackOptions& options) {
  check_options(options);
  std::vector<ObjectEstimate> estimates;
  std::vector<Track> tracks = assign_observations(frames, options);
  keep_names(frames, options, tracks);
  join_restarts(frames, options, tracks);
  for (std::size_t k = 0; k < tracks.size(); ++k) {
    Track& track = tracks[k];
    const bool goes_on =
        k + 1 < tracks.size() && tracks[k + 1].identity == track.identity &&
        support_of(frames, tracks[k + 1]).begin - support_of(frames, track).end <= options.max_gap;
    trim(frames, options, goes_on, track);
    const auto count = std::count_if(track.seen.begin(), track.seen.end(), [&](const Seen& seen) {
      return !observation(frames, seen).doubtful;
    });
    if (count < options.min_observations) continue;
    const std::vector<Gaussian> states = smooth_robustly(data_of(frames, track, options), options);
    for (std::size_t i = 0; i < states.size(); ++i) {
      const ObjectObservation& seen = observation(frames, track.seen[i]);
      ObjectEstimate estimate;
      estimate.frame = static_cast<std::int64_t>(track.seen[i].frame);
      estimate.instance = track.identity;
      estimate.label = seen.label;
      estimate.p_moving = seen.p_moving;
      estimate.keypoints = seen.keypoints;
      estimate.position = states[i].mean.head<3>();
      estimate.velocity = states[i].mean.tail<3>();
      estimate.velocity_covariance = states[i].covariance.bottomRightCorner<3, 3>();
      estimates.push_back(estimate);
    }
  }
  std::sort(estimates.begin(), estimates.end(), [](const auto& a, const auto& b) {
    return std::tie(a.frame, a.instance) < std::tie(b.frame, b.instance);
  });
  return estimates;
}

}  // namespace kys_slam