// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_matcher.h"

#include <limits>

#include "matching/landmark_search.h"

namespace kys_slam {

void describe(kys::OptionList& list, DescriptorMatchOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("descriptor_match.max_distance", o.max_distance, {0, 1e6}, "bits");
  list.add("descriptor_match.ratio", o.ratio, {0.1, 10});
}

namespace {

struct Best {
  std::int32_t feature = -1;
  float distance = std::numeric_limits<float>::infinity();
};

Best find(const DescriptorQuery& query, const FrameFeatures& features,
          const DescriptorMatchOptions& options, const kys::DistanceModel& model,
          kys::Statistics& statistics) {
  Best best;
  float second = std::numeric_limits<float>::infinity();
  kys::Tier tier = kys::Tier::kBypassed;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const kys::Distance d =
        model.evaluate(*query.descriptor, *query.prior, features.descriptor(i), features.prior(i),
                       kys::Context::kTemporal, second, statistics);
    if (d.value < best.distance) {
      second = best.distance;
      best = {static_cast<std::int32_t>(i), d.value};
      tier = d.tier;
    } else if (d.value < second) {
      second = d.value;
    }
  }
  if (best.distance > options.max_distance || best.distance >= options.ratio * second) return {};
  statistics.accept(tier);
  return best;
}

}  // namespace

std::vector<std::int32_t> match_descriptors(std::span<const DescriptorQuery> queries,
                                            const FrameFeatures& features,
                                            const DescriptorMatchOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics) {
  std::vector<Best> matches(queries.size());
  std::vector<std::int32_t> owner(features.size(), -1);
  for (std::size_t q = 0; q < queries.size(); ++q) {
    const Best best = find(queries[q], features, options, model, statistics);
    if (best.feature < 0) continue;
    std::int32_t& holder = owner[static_cast<std::size_t>(best.feature)];
    if (holder >= 0) {
      Best& rival = matches[static_cast<std::size_t>(holder)];
      if (rival.distance <= best.distance) continue;
      rival = {};
    }
    holder = static_cast<std::int32_t>(q);
    matches[q] = best;
  }
  std::vector<std::int32_t> result(queries.size(), -1);
  std::vector<float> turns;
  std::vector<std::size_t> matched;
  for (std::size_t q = 0; q < queries.size(); ++q) {
    result[q] = matches[q].feature;
    if (matches[q].feature < 0) continue;
    turns.push_back(queries[q].angle -
                    features.keypoint(static_cast<std::size_t>(matches[q].feature)).angle);
    matched.push_back(q);
  }
  if (options.check_rotation) {
    const std::vector<std::uint8_t> kept = consistent_rotations(turns);
    for (std::size_t k = 0; k < matched.size(); ++k) {
      if (kept[k] == 0) result[matched[k]] = -1;
    }
  }
  return result;
}

}  // namespace kys_slam
