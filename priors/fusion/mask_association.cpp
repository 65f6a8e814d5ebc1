// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/mask_association.h"

#include <dlib/matrix.h>
#include <dlib/optimization/max_cost_assignment.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "priors/fusion/association.h"

namespace kys_slam {
namespace {

constexpr double kLeastGain = 0.15;  // of overlap and keypoints: below, it is another object
constexpr double kKeypointGain = 0.5;
constexpr double kDisparityGain = 0.5;
constexpr int kFewPixels = 30;       // by disparity, below which they do not count
constexpr double kOneObject = 0.5;   // share of a left thing's pixels on one right thing, and back
constexpr int kFewVotes = 2;         // keypoints, below which they do not count
constexpr double kSmoothing = 0.5;   // of the speed in the image
constexpr double kVoteKept = 0.95;   // of the votes for a class, per frame and camera: about 1 s
constexpr double kMotionKept = 0.7;  // of the information of a velocity, per frame
constexpr double kInliers = 0.5;     // share of keypoints that fit one motion: else they are mixed
constexpr auto kNone = static_cast<std::size_t>(-1);

/// Share of a segment's keypoints that were found on each other segment.
std::map<std::uint16_t, double> shares(const SegmentLinks::Votes& votes, std::uint16_t segment,
                                       int few) {
  std::map<std::uint16_t, double> result;
  int total = 0;
  for (auto at = votes.lower_bound({segment, 0}); at != votes.end() && at->first.first == segment;
       ++at) {
    total += at->second;
    if (at->second >= few) result[at->first.second] = at->second;
  }
  for (auto& [other, share] : result) share /= total;
  return result;
}

/// Assigns tracks to things with the largest sum of gains; those below kLeastGain do not count.
/// \return by thing: its track, or kNone
std::vector<std::size_t> assign(std::vector<std::map<std::size_t, double>> gain,
                                std::size_t tracks) {
  // Most pairs have nothing in common: the others make a small problem.
  std::vector<std::size_t> things, track_of;
  std::vector<long> column_of(tracks, -1);
  for (std::size_t i = 0; i < gain.size(); ++i) {
    std::erase_if(gain[i], [](const auto& of_track) { return of_track.second < kLeastGain; });
    if (!gain[i].empty()) things.push_back(i);
    for (const auto& [track, value] : gain[i]) {
      if (column_of[track] >= 0) continue;
      column_of[track] = static_cast<long>(track_of.size());
      track_of.push_back(track);
    }
  }
  std::vector<std::size_t> chosen(gain.size(), kNone);
  const auto n = static_cast<long>(std::max(things.size(), track_of.size()));
  if (n == 0) return chosen;
  dlib::matrix<std::int64_t> square(n, n);
  square = 0;
  for (std::size_t row = 0; row < things.size(); ++row) {
    for (const auto& [track, value] : gain[things[row]]) {
      square(static_cast<long>(row), column_of[track]) = std::llround(1e6 * value);
    }
  }
  const std::vector<long> column = dlib::max_cost_assignment(square);
  for (std::size_t row = 0; row < things.size(); ++row) {
    if (square(static_cast<long>(row), column[row]) == 0) continue;
    chosen[things[row]] = track_of[static_cast<std::size_t>(column[row])];
  }
  return chosen;
}

}  // namespace

SegmentLinks::Votes links_by_disparity(const PanopticMap& left, const PanopticMap& right,
                                       const ImageOf<float>& disparity) {
  SegmentLinks::Votes votes;
  for (int y = 0; y < left.map.height(); ++y) {
    for (const SegmentRun& run : left.runs.row(y)) {
      if (run.segment == 0 || !left.segments[run.segment - 1u].thing) continue;
      std::uint16_t met = 0;  // the right thing that the last pixels fell on
      int count = 0;
      const auto add = [&] {
        if (count > 0) votes[{run.segment, met}] += count;
        count = 0;
      };
      for (int x = run.x0; x < run.x1; ++x) {
        const float d = disparity.at(x, y);
        const auto to = static_cast<float>(x) - d + 0.5F;
        if (!(d > 0 && to >= 0)) continue;
        const std::uint16_t segment = right.map.at(static_cast<int>(to), y);
        if (segment == 0 || !right.segments[segment - 1u].thing) continue;
        if (segment != met) add();
        met = segment;
        ++count;
      }
      add();
    }
  }
  return votes;
}

/// Intersection over union of a track's mask, moved to where it is expected, with the segments.
std::map<std::uint16_t, double> MaskAssociator::overlaps(const View& view, std::size_t c,
                                                         const PanopticMap& map,
                                                         const std::vector<SegmentShape>& shapes,
                                                         const SegmentLinks& links) const {
  std::map<std::uint16_t, double> result;
  double du = view.speed_u * (view.missed + 1), dv = view.speed_v * (view.missed + 1);
  const auto seen = links.shifts[c].find(view.segment);
  if (view.missed == 0 && seen != links.shifts[c].end() && seen->second.count >= kFewVotes) {
    du = seen->second.u;
    dv = seen->second.v;
  }
  const int right = static_cast<int>(std::lround(du)), down = static_cast<int>(std::lround(dv));
  std::vector<int> common(map.segments.size() + 1, 0);  // px by segment
  double area = 0;
  for (const MaskRun& run : view.mask) {
    const int y = run.y + down;
    if (y < 0 || y >= map.runs.rows()) continue;
    const int x0 = std::max(0, run.x0 + right), x1 = std::min(map.map.width(), run.x1 + right);
    area += std::max(0, x1 - x0);
    const auto row = map.runs.row(y);
    auto at = std::partition_point(row.begin(), row.end(),
                                   [&](const SegmentRun& r) { return r.x1 <= x0; });
    for (; at != row.end() && at->x0 < x1; ++at) {
      common[at->segment] += std::min<int>(at->x1, x1) - std::max<int>(at->x0, x0);
    }
  }
  for (std::size_t k = 1; k < common.size(); ++k) {
    if (common[k] == 0) continue;
    result[static_cast<std::uint16_t>(k)] = common[k] / (area + shapes[k - 1].area - common[k]);
  }
  return result;
}

std::vector<ExpectedThing> MaskAssociator::expected(std::size_t camera) const {
  std::vector<ExpectedThing> things;
  for (const Track& track : tracks_) {
    const View& view = track.views[camera];
    ExpectedThing& thing = things.emplace_back();
    thing.motion = track.motion;
    thing.frames = track.frames;
    const auto du = static_cast<int>(std::lround(view.speed_u * (view.missed + 1)));
    const auto dv = static_cast<int>(std::lround(view.speed_v * (view.missed + 1)));
    for (const MaskRun& run : view.mask) {
      thing.mask.push_back({run.y + dv, std::max(0, run.x0 + du), std::max(0, run.x1 + du)});
    }
  }
  return things;
}

void MaskAssociator::observe(std::size_t camera, std::span<const KeypointEvidence> evidence) {
  for (Track& track : tracks_) {
    const View& view = track.views[camera];
    if (view.missed > 0 || view.mask.empty() || view.segment > evidence.size()) continue;
    const KeypointEvidence& seen = evidence[view.segment - 1U];
    if (seen.span <= 0 || seen.inliers < kInliers * seen.matches) continue;
    const double weight = 1 / (seen.velocity_sigma * seen.velocity_sigma);
    if (!track.motion) {
      track.motion = {seen.velocity, seen.velocity_sigma};
      continue;
    }
    const double before = kMotionKept / (track.motion->sigma * track.motion->sigma);
    track.motion->velocity =
        (before * track.motion->velocity + weight * seen.velocity) / (before + weight);
    track.motion->sigma = 1 / std::sqrt(before + weight);
  }
}

std::uint16_t MaskAssociator::label_of(std::int32_t identity) const {
  const auto at = std::find_if(tracks_.begin(), tracks_.end(),
                               [&](const Track& track) { return track.identity == identity; });
  const auto more = [](const auto& a, const auto& b) { return a.second < b.second; };
  return std::max_element(at->votes.begin(), at->votes.end(), more)->first;
}

void MaskAssociator::vote(Track& track, std::uint16_t label) const {
  for (auto& [voted, votes] : track.votes) votes *= kVoteKept;
  track.votes[label] += 1;
}

void MaskAssociator::associate(std::size_t c, const PanopticMap& map, const SegmentLinks& links,
                               const std::vector<std::vector<std::int32_t>>& given,
                               std::vector<std::int32_t>& identities) {
  const std::vector<SegmentShape> shapes = segment_shapes(map.runs, map.segments.size());
  std::vector<std::size_t> things;
  std::map<std::uint16_t, std::size_t> row_of;
  for (std::size_t k = 0; k < map.segments.size(); ++k) {
    if (!map.segments[k].thing) continue;
    row_of[static_cast<std::uint16_t>(k + 1)] = things.size();
    things.push_back(k);
  }
  check_assignment(things.size(), tracks_.size());
  std::vector<std::map<std::size_t, double>> gain(things.size());  // by thing and track
  const auto add = [&](std::uint16_t segment, std::size_t track, double value) {
    const auto row = row_of.find(segment);
    if (row == row_of.end()) return;
    if (group_of(map.segments[segment - 1u].label) != group_of(tracks_[track].label)) return;
    gain[row->second][track] += value;
  };
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    const View& view = tracks_[t].views[c];
    for (const auto& [segment, overlap] : overlaps(view, c, map, shapes, links)) {
      add(segment, t, overlap);
    }
    if (view.missed == 0 && !view.mask.empty()) {
      for (const auto& [segment, share] : shares(links.in_time[c], view.segment, kFewVotes)) {
        add(segment, t, kKeypointGain * share);
      }
    }
    if (c == 0) continue;
    for (std::size_t k = 0; k < given[0].size(); ++k) {
      if (given[0][k] != tracks_[t].identity) continue;
      const auto left = static_cast<std::uint16_t>(k + 1);
      for (const auto& [segment, share] : shares(links.in_stereo, left, kFewVotes)) {
        add(segment, t, kKeypointGain * share);
      }
      for (const auto& [segment, share] : shares(links.by_disparity, left, kFewPixels)) {
        add(segment, t, kDisparityGain * share);
      }
    }
  }
  const std::vector<std::size_t> chosen = assign(std::move(gain), tracks_.size());
  for (Track& track : tracks_) ++track.views[c].missed;
  for (std::size_t i = 0; i < things.size(); ++i) {
    const std::size_t k = things[i];
    std::size_t t = chosen[i];
    if (t == kNone) {
      t = tracks_.size();
      Track& added = tracks_.emplace_back();
      added.identity = next_identity_++;
      added.label = map.segments[k].label;
    }
    Track& track = tracks_[t];
    View& view = track.views[c];
    const bool known = !view.mask.empty();
    if (known) {
      const auto seen = links.shifts[c].find(view.segment);
      const bool followed =
          view.missed == 1 && seen != links.shifts[c].end() && seen->second.count >= kFewVotes;
      const double du = followed ? seen->second.u : (shapes[k].u - view.u) / view.missed;
      const double dv = followed ? seen->second.v : (shapes[k].v - view.v) / view.missed;
      view.speed_u += kSmoothing * (du - view.speed_u);
      view.speed_v += kSmoothing * (dv - view.speed_v);
    }
    view.mask.clear();
    view.segment = static_cast<std::uint16_t>(k + 1);
    view.u = shapes[k].u;
    view.v = shapes[k].v;
    view.missed = 0;
    track.label = map.segments[k].label;
    vote(track, track.label);
    ++track.frames;
    identities[k] = track.identity;
  }
  std::vector<std::size_t> track_of(map.segments.size() + 1, tracks_.size());
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    const View& view = tracks_[t].views[c];
    if (view.missed == 0 && view.mask.empty() && view.segment > 0) track_of[view.segment] = t;
  }
  for (int y = 0; y < map.runs.rows(); ++y) {
    for (const SegmentRun& run : map.runs.row(y)) {
      const std::size_t t = track_of[run.segment];
      if (run.segment == 0 || t == tracks_.size()) continue;
      tracks_[t].views[c].mask.push_back({y, run.x0, run.x1});
    }
  }
}

/// A left and a right thing of this frame whose pixels mostly meet are one object: where each is a
/// track that the other view does not see now, the two become the older one.
void MaskAssociator::join_views(const PanopticMap& left, const PanopticMap& right,
                                const SegmentLinks& links,
                                std::vector<std::vector<std::int32_t>>& identities) {
  std::map<std::uint16_t, int> seen_left, seen_right;  // pixels by segment
  for (const auto& [pair, votes] : links.by_disparity) {
    seen_left[pair.first] += votes;
    seen_right[pair.second] += votes;
  }
  const auto track_of = [&](std::int32_t identity) {
    return std::find_if(tracks_.begin(), tracks_.end(),
                        [&](const Track& track) { return track.identity == identity; });
  };
  for (const auto& [pair, votes] : links.by_disparity) {
    const auto [l, r] = pair;
    if (votes < kFewPixels || votes < kOneObject * seen_left[l] ||
        votes < kOneObject * seen_right[r])
      continue;
    if (group_of(left.segments[l - 1u].label) != group_of(right.segments[r - 1u].label)) continue;
    std::int32_t &a = identities[0][l - 1u], &b = identities[1][r - 1u];
    if (a == b) continue;
    const auto from_left = track_of(a), from_right = track_of(b);
    const View &other_right = from_left->views[1], &other_left = from_right->views[0];
    const bool free_right = other_right.mask.empty() || other_right.missed > 0;
    const bool free_left = other_left.mask.empty() || other_left.missed > 0;
    if (!free_right || !free_left) continue;
    from_left->views[1] = from_right->views[1];
    from_left->identity = std::min(a, b);
    for (const auto& [label, count] : from_right->votes) from_left->votes[label] += count;
    from_left->frames = std::max(from_left->frames, from_right->frames);
    if (!from_left->motion) from_left->motion = from_right->motion;
    a = b = from_left->identity;
    tracks_.erase(from_right);
  }
  std::sort(tracks_.begin(), tracks_.end(),
            [](const Track& x, const Track& y) { return x.identity < y.identity; });
}

std::vector<std::vector<std::int32_t>> MaskAssociator::next_frame(
    std::span<const PanopticMap* const> cameras, const SegmentLinks& links, std::size_t& c) {
  std::vector<std::vector<std::int32_t>> identities;
  for (const PanopticMap* map : cameras) identities.emplace_back(map->segments.size(), -1);
  for (c = 0; c < cameras.size(); ++c) {
    associate(c, *cameras[c], links, identities, identities[c]);
  }
  if (cameras.size() == 2) join_views(*cameras[0], *cameras[1], links, identities);
  const auto forgotten = [&](const View& view) {
    return view.mask.empty() || view.missed > options_.max_missed_frames;
  };
  std::erase_if(tracks_, [&](const Track& track) {
    return std::all_of(track.views.begin(), track.views.end(), forgotten);
  });
  return identities;
}

}  // namespace kys_slam
