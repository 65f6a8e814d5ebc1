// SPDX-License-Identifier: BSD-3-Clause
#include "motion/object_assignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

namespace kys_slam::objects {
namespace {

constexpr double kOtherVelocity = 16.3;  // chi-square of 3 degrees of freedom, 99.9 %

class Assigner {
 public:
  Assigner(std::span<const ObjectFrame> frames, const ObjectTrackOptions& options)
      : frames_(frames), options_(options) {}

  std::vector<Track> run() {
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      if (frames_[k].T_w_c) step(k);
    }
    for (Track& track : active_) end(std::move(track));
    return std::move(ended_);
  }

 private:
  /// How well an observation continues a track: nothing when it cannot; less is better. The middle
  /// of what is seen is compared with where it should be now; the same name is worth half the gate.
  /// The gate grows with time without observation, with the uncertainty of the velocity (1 sigma)
  /// and of the place (2 sigma): of a far car few keypoints are seen, and their middle jumps.
  [[nodiscard]] std::optional<double> cost(const Track& track, const ObjectFrame& frame,
                                           const ObjectObservation& seen) const {
    if (!seen.place) return std::nullopt;
    const bool named = track.instance == seen.instance;
    if (!named && track.label != seen.label) return std::nullopt;
    const double dt = frame.taken - track.time;
    const Eigen::Matrix3d& P = track.state.covariance.bottomRightCorner<3, 3>();
    const double gate = options_.gate + options_.gate_growth * dt + dt * std::sqrt(P.trace()) +
                        2 * std::sqrt(seen.place->covariance.trace());
    const double distance = jump(track, frame, *seen.place);
    if (distance > gate || (!track.astray.empty() && contradicts(track, frame, seen))) {
      return std::nullopt;
    }
    return distance / gate - (named ? 0.5 : 0.0);
  }

  /// Whether an observation near where a track should be has another velocity: after others that
  /// went astray, it is one of those.
  [[nodiscard]] bool contradicts(const Track& track, const ObjectFrame& frame,
                                 const ObjectObservation& seen) const {
    if (!seen.velocity) return false;
    const Gaussian state =
        predict(track.state, frame.taken - track.time, options_.acceleration_density);
    const Observed velocity = world_velocity(frame, *seen.velocity, options_);
    const Eigen::Vector3d away = velocity.value - state.mean.tail<3>();
    const Eigen::Matrix3d S = velocity.covariance + state.covariance.bottomRightCorner<3, 3>();
    return away.dot(S.ldlt().solve(away)) > kOtherVelocity;
  }

  /// m, from where the middle of what is seen of a track should be now.
  [[nodiscard]] static double jump(const Track& track, const ObjectFrame& frame,
                                   const ObservedPlace& seen) {
    const double dt = frame.taken - track.time;
    const Eigen::Vector3d expected = track.centre + dt * track.state.mean.tail<3>();
    return (*frame.T_w_c * seen.centre_c - expected).norm();
  }

  /// Assigns greedily, the least cost first. Objects are few and metres apart; names decide where
  /// two of a class pass each other.
  void step(std::size_t k) {
    const ObjectFrame& frame = frames_[k];
    end_old(frame.taken);
    std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;  // cost, track, observation
    for (std::size_t t = 0; t < active_.size(); ++t) {
      for (std::size_t o = 0; o < frame.observations.size(); ++o) {
        if (const auto c = cost(active_[t], frame, frame.observations[o])) {
          pairs.emplace_back(*c, t, o);
        }
      }
    }
    std::sort(pairs.begin(), pairs.end());
    std::vector<bool> continued(active_.size(), false);
    std::vector<bool> taken(frame.observations.size(), false);
    for (const auto& [c, t, o] : pairs) {
      if (continued[t] || taken[o]) continue;
      continued[t] = taken[o] = true;
      extend(active_[t], k, o);
    }
    for (std::size_t o = 0; o < frame.observations.size(); ++o) {
      if (!taken[o]) go_by_name(k, o, continued);
    }
  }

  /// An observation that no track expects where it is. An object that comes out from behind another
  /// shows the edge of that one first, then its own front: the middle jumps by metres, while the
  /// priors keep its name. Up to `restart_gate` it keeps its identity with a new filter; farther
  /// away the name is wrong.
  void go_by_name(std::size_t k, std::size_t o, std::vector<bool>& continued) {
    const ObjectFrame& frame = frames_[k];
    const ObjectObservation& seen = frame.observations[o];
    std::size_t t = 0;
    while (t < continued.size() && (continued[t] || active_[t].instance != seen.instance)) ++t;
    if (t == continued.size()) {
      seen.place ? start(k, o, free_identity(seen.instance)) : wait(k, o);
      return;
    }
    continued[t] = true;
    if (!seen.place) {
      pass_over_astray(active_[t]);
      active_[t].seen.push_back({k, o});
    } else {
      go_astray(t, k, o);
    }
  }

  /// An object is elsewhere than it should be: once, because its keypoints are on something else,
  /// or from now on. Only the latter starts its motion anew.
  void go_astray(std::size_t t, std::size_t k, std::size_t o) {
    Track& track = active_[t];
    if (!track.astray.empty() && !follows(track.astray.back(), {k, o})) pass_over_astray(track);
    track.astray.push_back({k, o});
    if (track.astray.size() < static_cast<std::size_t>(options_.restart_observations)) return;
    const std::vector<Seen> elsewhere = std::move(track.astray);
    track.astray.clear();
    const ObjectFrame& frame = frames_[elsewhere.front().frame];
    const ObjectObservation& seen = frame.observations[elsewhere.front().observation];
    const bool keeps = jump(track, frame, *seen.place) <= options_.restart_gate;
    const std::int32_t identity = keeps ? track.identity : free_identity(seen.instance);
    Track again = started(elsewhere.front().frame, elsewhere.front().observation, identity);
    for (std::size_t i = 1; i < elsewhere.size(); ++i) {
      note_next(again, elsewhere[i].frame, elsewhere[i].observation);
    }
    if (keeps) {
      ended_.push_back(std::move(track));
      active_[t] = std::move(again);
    } else {
      active_.push_back(std::move(again));
    }
  }

  /// Whether an object can be at the two places.
  [[nodiscard]] bool follows(const Seen& before, const Seen& now) const {
    const auto place = [&](const Seen& s) {
      return *frames_[s.frame].T_w_c * frames_[s.frame].observations[s.observation].place->centre_c;
    };
    const double dt = frames_[now.frame].taken - frames_[before.frame].taken;
    return (place(now) - place(before)).norm() <= options_.gate + options_.start_speed * dt;
  }

  /// What was astray was so for a moment: it says that the object is there, not where.
  static void pass_over_astray(Track& track) {
    for (Seen& seen : track.astray) {
      seen.used = false;
      track.seen.push_back(seen);
    }
    track.astray.clear();
  }

  void end(Track track) {
    pass_over_astray(track);
    ended_.push_back(std::move(track));
  }

  /// Without a place nothing starts; kept for when the object is seen better.
  void wait(std::size_t k, std::size_t o) {
    auto& waiting = waiting_[frames_[k].observations[o].instance];
    if (!waiting.empty() &&
        frames_[k].taken - frames_[waiting.back().frame].taken > options_.max_gap) {
      waiting.clear();
    }
    waiting.push_back({k, o});
  }

  void end_old(double now) {
    std::vector<Track> kept;
    for (Track& track : active_) {
      if (now - track.time > options_.max_gap) {
        end(std::move(track));
      } else {
        kept.push_back(std::move(track));
      }
    }
    active_ = std::move(kept);
  }

  void extend(Track& track, std::size_t k, std::size_t o) {
    waiting_.erase(frames_[k].observations[o].instance);  // what waited was in the track's place
    pass_over_astray(track);
    note_next(track, k, o);
  }

  void note_next(Track& track, std::size_t k, std::size_t o) {
    const ObjectFrame& frame = frames_[k];
    track.state = predict(track.state, frame.taken - track.time, options_.acceleration_density);
    note(track, k, o, frame, frame.observations[o]);
  }

  void note(Track& track, std::size_t k, std::size_t o, const ObjectFrame& frame,
            const ObjectObservation& seen) {
    const Observed place = world_place(frame, *seen.place, options_);
    observe_position(track.state, place.value, place.covariance);
    if (seen.velocity) {
      const Observed velocity = world_velocity(frame, *seen.velocity, options_);
      observe_velocity(track.state, velocity.value, velocity.covariance);
    }
    track.seen.push_back({k, o});
    track.time = frame.taken;
    track.instance = seen.instance;
    track.label = seen.label;
    track.centre = place.value;
  }

  void start(std::size_t k, std::size_t o, std::int32_t identity) {
    active_.push_back(started(k, o, identity));
  }

  Track started(std::size_t k, std::size_t o, std::int32_t identity) {
    const ObjectFrame& frame = frames_[k];
    const ObjectObservation& seen = frame.observations[o];
    Track track;
    track.identity = identity;
    if (const auto waiting = waiting_.find(seen.instance); waiting != waiting_.end()) {
      const std::size_t last = waiting->second.back().frame;
      if (frame.taken - frames_[last].taken <= options_.max_gap) {
        track.seen = std::move(waiting->second);
      }
      waiting_.erase(waiting);
    }
    const Observed place = world_place(frame, *seen.place, options_);
    track.state.mean.head<3>() = place.value;
    track.state.covariance.topLeftCorner<3, 3>() = place.covariance;
    track.state.covariance.bottomRightCorner<3, 3>().diagonal().setConstant(options_.start_speed *
                                                                            options_.start_speed);
    track.time = frame.taken;
    note(track, k, o, frame, seen);
    return track;
  }

  /// The priors' own name, unless a tracked object has it: then one that priors never use
  /// (those of the left camera are below 2^30, those of the right one are not used).
  std::int32_t free_identity(std::int32_t instance) {
    const bool used = std::any_of(active_.begin(), active_.end(),
                                  [&](const Track& t) { return t.identity == instance; });
    return used ? next_identity_++ : instance;
  }

  std::span<const ObjectFrame> frames_;
  const ObjectTrackOptions& options_;
  std::vector<Track> active_;
  std::vector<Track> ended_;
  std::map<std::int32_t, std::vector<Seen>> waiting_;  // without place, of names that no track has
  std::int32_t next_identity_ = 1 << 30;
};

}  // namespace

std::vector<Track> assign_observations(std::span<const ObjectFrame> frames,
                                       const ObjectTrackOptions& options) {
  return Assigner(frames, options).run();
}

}  // namespace kys_slam::objects
