// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "map/frame_features.h"

namespace kys_slam {

/// A descriptor to match with any feature of a frame.
struct DescriptorQuery {
  const kys::Descriptor* descriptor = nullptr;
  const kys::Prior* prior = nullptr;
  float angle = 0;  ///< rad
};

struct DescriptorMatchOptions {
  float max_distance = 50;  ///< bits
  float ratio = 0.7f;       ///< best / second best
  bool check_rotation = true;
};
/// For check_options().
void describe(kys::OptionList& list, DescriptorMatchOptions& options);

/// Matches by descriptor only, without predicted positions: every query against every feature, with
/// ratio test and rotation consistency. For a frame of unknown pose.
/// \return feature per query, -1: none. A feature is used at most once.
std::vector<std::int32_t> match_descriptors(std::span<const DescriptorQuery> queries,
                                            const FrameFeatures& features,
                                            const DescriptorMatchOptions& options,
                                            const kys::DistanceModel& model,
                                            kys::Statistics& statistics);

}  // namespace kys_slam
