// SPDX-License-Identifier: BSD-3-Clause
#include "motion/object_tracks.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <tuple>

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

using State = Eigen::Matrix<double, 6, 1>;  // position (m), velocity (m/s)
using Covariance = Eigen::Matrix<double, 6, 6>;

constexpr int kRobustRounds = 10;
constexpr double kQuarterWeight =
    9;  // chi-square at which an observation has a quarter of its weight

constexpr double kOtherVelocity = 16.3;  // chi-square of 3 degrees of freedom, 99.9 %
constexpr double kFar = 100;             // m, standard deviation of a place before it is seen

struct Gaussian {
  State mean = State::Zero();
  Covariance covariance = Covariance::Zero();
};

Covariance transition(double dt) {
  Covariance F = Covariance::Identity();
  F.topRightCorner<3, 3>().diagonal().setConstant(dt);
  return F;
}

/// Vehicles keep their velocity for a second and more, and what changes it is unknown: a constant
/// velocity with white acceleration has one parameter, and gives the right growth of uncertainty
/// for any interval between images. White acceleration, integrated exactly.
Gaussian predict(const Gaussian& from, double dt, double density) {
  const Covariance F = transition(dt);
  Gaussian to{F * from.mean, F * from.covariance * F.transpose()};
  to.covariance.topLeftCorner<3, 3>().diagonal().array() += density * dt * dt * dt / 3;
  to.covariance.topRightCorner<3, 3>().diagonal().array() += density * dt * dt / 2;
  to.covariance.bottomLeftCorner<3, 3>().diagonal().array() += density * dt * dt / 2;
  to.covariance.bottomRightCorner<3, 3>().diagonal().array() += density * dt;
  return to;
}

/// `value` observes the position (offset 0) or the velocity (offset 3).
void update(Gaussian& state, int offset, const Eigen::Vector3d& value, const Eigen::Matrix3d& R) {
  const Eigen::Matrix<double, 6, 3> PHt = state.covariance.middleCols<3>(offset);
  const Eigen::Matrix3d S = PHt.middleRows<3>(offset) + R;
  const Eigen::Matrix<double, 6, 3> K = S.ldlt().solve(PHt.transpose()).transpose();
  state.mean += K * (value - state.mean.segment<3>(offset));
  const Covariance P = state.covariance - K * PHt.transpose();
  state.covariance = 0.5 * (P + P.transpose());
}

struct Place {
  Eigen::Vector3d value;
  Eigen::Matrix3d covariance;
};
Place world_place(const ObjectFrame& frame, const ObservedPlace& seen,
                  const ObjectTrackOptions& options) {
  const Eigen::Matrix3d R = frame.T_w_c->R();
  Eigen::Matrix3d covariance = R * seen.covariance * R.transpose();
  covariance.diagonal().array() += options.surface_sigma * options.surface_sigma;
  return {*frame.T_w_c * seen.centre_c, covariance};
}
Place world_velocity(const ObjectFrame& frame, const ObservedVelocity& seen,
                     const ObjectTrackOptions& options) {
  const Eigen::Matrix3d R = frame.T_w_c->R();
  Eigen::Matrix3d covariance = R * seen.covariance * R.transpose();
  covariance.diagonal().array() += options.speed_sigma * options.speed_sigma;
  return {R * seen.velocity_c, covariance};
}

struct Seen {
  std::size_t frame = 0;
  std::size_t observation = 0;
  bool used = true;  // for position and velocity
};

/// An object that is tracked. The first observations may be without place: they came before the one
/// that started it.
struct Track {
  std::int32_t identity = 0;
  std::int32_t instance = 0;  // the name under which it was seen last
  std::uint16_t label = 0;
  std::vector<Seen> seen;
  std::vector<Seen> astray;                          // after these, of its name, elsewhere
  double time = 0;                                   // s, of the last one seen
  Gaussian state;                                    // then
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  // m, seen last, in the world
};

/// Assigns observations to tracks, frame by frame.
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
    const Place velocity = world_velocity(frame, *seen.velocity, options_);
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
    const Place place = world_place(frame, *seen.place, options_);
    update(track.state, 0, place.value, place.covariance);
    if (seen.velocity) {
      const Place velocity = world_velocity(frame, *seen.velocity, options_);
      update(track.state, 3, velocity.value, velocity.covariance);
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
    const Place place = world_place(frame, *seen.place, options_);
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

/// What is observed of a track, per frame in which it is seen.
struct TrackData {
  std::vector<double> times;                   // s
  std::vector<std::optional<Place>> places;    // m
  std::vector<std::vector<Place>> velocities;  // m/s, each in the middle of its span
};

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

/// Filters a track forward, then smooths it backward (Rauch, Tung, Striebel). The state after each
/// observation, in their order.
std::vector<Gaussian> smooth(const TrackData& data, const ObjectTrackOptions& options) {
  const std::size_t count = data.times.size();
  const auto time = [&](std::size_t i) { return data.times[i]; };
  const auto& places = data.places;
  std::vector<Gaussian> predicted(count);
  std::vector<Gaussian> filtered(count);
  predicted[0].mean.head<3>() = (*std::find_if(places.begin(), places.end(), [](const auto& p) {
                                  return p.has_value();
                                }))->value;
  predicted[0].covariance.diagonal().head<3>().setConstant(kFar * kFar);
  predicted[0].covariance.diagonal().tail<3>().setConstant(options.start_speed *
                                                           options.start_speed);
  for (std::size_t i = 0; i < count; ++i) {
    if (i > 0) {
      predicted[i] = predict(filtered[i - 1], time(i) - time(i - 1), options.acceleration_density);
    }
    filtered[i] = predicted[i];
    if (places[i]) update(filtered[i], 0, places[i]->value, places[i]->covariance);
    for (const Place& v : data.velocities[i]) update(filtered[i], 3, v.value, v.covariance);
  }
  std::vector<Gaussian> smoothed = filtered;
  for (std::size_t i = count - 1; i-- > 0;) {
    const Covariance F = transition(time(i + 1) - time(i));
    const Covariance G =
        predicted[i + 1].covariance.ldlt().solve(F * filtered[i].covariance).transpose();
    smoothed[i].mean += G * (smoothed[i + 1].mean - predicted[i + 1].mean);
    smoothed[i].covariance +=
        G * (smoothed[i + 1].covariance - predicted[i + 1].covariance) * G.transpose();
  }
  return smoothed;
}

/// The same where some observations are wrong: each counts the less the farther it is from the
/// states that all give together (weights of Geman and McClure). Of an object that comes into view
/// the edge of what hides it is seen first, and moves otherwise.
std::vector<Gaussian> smooth_robustly(const TrackData& data, const ObjectTrackOptions& options) {
  std::vector<Gaussian> states = smooth(data, options);
  for (int round = 0; round < kRobustRounds; ++round) {
    TrackData weighted = data;
    const auto weigh = [](Place& seen, const Eigen::Vector3d& value) {
      const Eigen::Vector3d away = seen.value - value;
      const double chi2 = away.dot(seen.covariance.ldlt().solve(away));
      const double less = 1 + chi2 / kQuarterWeight;
      seen.covariance *= less * less;
    };
    for (std::size_t i = 0; i < states.size(); ++i) {
      if (weighted.places[i]) weigh(*weighted.places[i], states[i].mean.head<3>());
      for (Place& velocity : weighted.velocities[i]) weigh(velocity, states[i].mean.tail<3>());
    }
    states = smooth(weighted, options);
  }
  return states;
}

}  // namespace

std::vector<ObjectEstimate> track_objects(std::span<const ObjectFrame> frames,
                                          const ObjectTrackOptions& options) {
  check_options(options);
  std::vector<ObjectEstimate> estimates;
  std::vector<Track> tracks = Assigner(frames, options).run();
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
