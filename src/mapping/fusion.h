// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include "map/map.h"

namespace kys_slam {

struct FusionOptions {
  std::size_t neighbours = 10;        ///< covisible keyframes
  std::size_t second_neighbours = 5;  ///< of each of those
  float radius = 3;                   ///< px at octave 0
  float max_distance = 50;            ///< bits
};
/// For check_options(). \param prefix of the keys
void describe(kys::OptionList& list, FusionOptions& options, std::string_view prefix = "mapping.");

/// Projects landmarks of `current` into its neighbours, and theirs into it. Two landmarks at one
/// feature are merged into the one with more observations (ORB-SLAM, Sec. VI-C). Returns the number
/// of merges and new observations.
int fuse_landmarks(Map& map, KeyFrameId current, const FusionOptions& options,
                   const kys::DistanceModel& model, kys::Statistics& statistics);

/// Projects landmarks into one keyframe, and adds observations or merges landmarks at matching
/// features. Returns the number of merges and new observations.
int fuse_into(Map& map, KeyFrameId keyframe, const std::vector<LandmarkId>& landmarks,
              const FusionOptions& options, const kys::DistanceModel& model,
              kys::Statistics& statistics);

}  // namespace kys_slam
