// SPDX-License-Identifier: BSD-3-Clause
#include "matching/landmark_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/chi_square.h"

namespace kys_slam {

void describe(kys::OptionList& list, SearchOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("search.max_distance", o.max_distance, {0, 1e6}, "bits");
  list.add("search.ratio", o.ratio, {0.1, 10});
}

namespace {

constexpr auto kChi2Mono = static_cast<float>(kChi2Mono95);
constexpr auto kChi2Stereo = static_cast<float>(kChi2Stereo95);

bool within_error_bound(const FrameFeatures& features, const ScaleLevels& scales, std::size_t i,
                        const SearchQuery& query) {
  const Keypoint& keypoint = features.keypoint(i);
  const float inv_sigma = scales.inv_sigma(keypoint.octave);
  const float du = keypoint.x - query.u;
  const float dv = keypoint.y - query.v;
  float error = du * du + dv * dv;
  if (!features.has_stereo(i)) return error * inv_sigma * inv_sigma <= kChi2Mono;
  const float dd = (keypoint.x - features.u_right(i)) - (query.u - query.u_right);
  error += dd * dd;
  return error * inv_sigma * inv_sigma <= kChi2Stereo;
}

SearchMatch best_feature(const FrameFeatures& features, const ScaleLevels& scales,
                         const SearchQuery& query, const SearchOptions& options,
                         const kys::DistanceModel& model, kys::Statistics& statistics) {
  SearchMatch best{-1, std::numeric_limits<float>::infinity()};
  float second = std::numeric_limits<float>::infinity();
  int best_octave = -1;
  int second_octave = -2;
  kys::Tier best_tier = kys::Tier::kBypassed;
  features.for_each_near(
      query.u, query.v, query.radius, query.min_octave, query.max_octave, [&](std::size_t i) {
        if (!options.taken.empty() && options.taken[i] != 0) return;
        if (features.has_stereo(i) &&
            std::abs(features.u_right(i) - query.u_right) > query.radius) {
          return;
        }
        if (options.check_error && !within_error_bound(features, scales, i, query)) return;
        const kys::Distance d =
            model.evaluate(*query.descriptor, *query.prior, features.descriptor(i),
                           features.prior(i), options.context, second, statistics);
        const int octave = features.keypoint(i).octave;
        if (d.value < best.distance) {
          second = best.distance;
          second_octave = best_octave;
          best = {static_cast<std::int32_t>(i), d.value};
          best_octave = octave;
          best_tier = d.tier;
        } else if (d.value < second) {
          second = d.value;
          second_octave = octave;
        }
      });
  if (best.feature < 0 || best.distance > options.max_distance) return {};
  const bool ambiguous =
      options.ratio < 1 && best_octave == second_octave && best.distance > options.ratio * second;
  if (ambiguous) return {};
  statistics.accept(best_tier);
  return best;
}

}  // namespace

std::vector<std::uint8_t> consistent_rotations(std::span<const float> turns) {
  constexpr int kBins = 30;
  constexpr float kTwoPi = 2.0f * std::numbers::pi_v<float>;
  std::array<int, kBins> histogram{};
  std::vector<int> bin(turns.size());
  for (std::size_t i = 0; i < turns.size(); ++i) {
    float turn = std::fmod(turns[i], kTwoPi);
    if (turn < 0) turn += kTwoPi;
    bin[i] = static_cast<int>(std::lround(turn / kTwoPi * kBins)) % kBins;
    ++histogram[static_cast<std::size_t>(bin[i])];
  }
  std::array<int, kBins> order{};
  for (int b = 0; b < kBins; ++b) order[static_cast<std::size_t>(b)] = b;
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return histogram[static_cast<std::size_t>(a)] > histogram[static_cast<std::size_t>(b)];
  });
  const int fullest = histogram[static_cast<std::size_t>(order[0])];
  std::array<bool, kBins> keep{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto b = static_cast<std::size_t>(order[k]);
    keep[b] = histogram[b] > 0 && 10 * histogram[b] >= fullest;
  }
  std::vector<std::uint8_t> kept(turns.size());
  for (std::size_t i = 0; i < turns.size(); ++i) kept[i] = keep[static_cast<std::size_t>(bin[i])];
  return kept;
}

SearchQuery query_for_feature(const FrameFeatures& features, std::size_t i,
                              const Eigen::Vector3d& pixel, const ScaleLevels& scales) {
  const Keypoint& seen = features.keypoint(i);
  SearchQuery query;
  query.u = static_cast<float>(pixel.x());
  query.v = static_cast<float>(pixel.y());
  query.u_right = static_cast<float>(pixel.z());
  query.min_octave = scales.lowest(std::max(0, seen.octave - 1));
  query.max_octave = scales.highest(std::min(scales.levels() - 1, seen.octave + 1));
  query.angle = seen.angle;
  query.descriptor = &features.descriptor(i);
  query.prior = &features.prior(i);
  return query;
}

std::vector<SearchMatch> search_features(const FrameFeatures& features, const ScaleLevels& scales,
                                         std::span<const SearchQuery> queries,
                                         const SearchOptions& options,
                                         const kys::DistanceModel& model,
                                         kys::Statistics& statistics) {
  std::vector<SearchMatch> matches(queries.size());
  std::vector<std::int32_t> owner(features.size(), -1);
  for (std::size_t q = 0; q < queries.size(); ++q) {
    const SearchMatch match =
        best_feature(features, scales, queries[q], options, model, statistics);
    if (match.feature < 0) continue;
    std::int32_t& holder = owner[static_cast<std::size_t>(match.feature)];
    if (holder >= 0) {
      SearchMatch& rival = matches[static_cast<std::size_t>(holder)];
      if (rival.distance <= match.distance) continue;
      rival = {};
    }
    holder = static_cast<std::int32_t>(q);
    matches[q] = match;
  }
  if (options.check_rotation) {
    std::vector<float> turns;
    std::vector<std::size_t> matched;
    for (std::size_t q = 0; q < queries.size(); ++q) {
      if (matches[q].feature < 0) continue;
      const auto feature = static_cast<std::size_t>(matches[q].feature);
      turns.push_back(queries[q].angle - features.keypoint(feature).angle);
      matched.push_back(q);
    }
    const std::vector<std::uint8_t> kept = consistent_rotations(turns);
    for (std::size_t k = 0; k < matched.size(); ++k) {
      if (kept[k] == 0) matches[matched[k]] = {};
    }
  }
  return matches;
}

}  // namespace kys_slam
