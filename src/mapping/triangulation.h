// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <cstdint>
#include <vector>

#include "map/landmark_id_allocator.h"
#include "map/map.h"
#include "matching/epipolar_matcher.h"

namespace kys_slam {

struct TriangulationOptions {
  std::size_t neighbours = 5;        ///< covisible keyframes that are matched
  double min_parallax_cos = 0.9998;  ///< largest cosine between the rays of two monocular features
  double scale_tolerance = 1.8;      ///< distance ratio against octave ratio, factor either way
  EpipolarOptions matching;
};
/// For check_options().
void describe(kys::OptionList& list, TriangulationOptions& options);

/// Triangulates new landmarks from features without a landmark in `current` and its best covisible
/// keyframes (ORB-SLAM, Sec. VI-C). The depth is that of the larger of ray and stereo parallax
/// (ORB-SLAM2). Returns their ids.
std::vector<LandmarkId> triangulate_landmarks(Map& map, KeyFrameId current,
                                              LandmarkIdAllocator& ids,
                                              const TriangulationOptions& options,
                                              const kys::DistanceModel& model,
                                              kys::Statistics& statistics);

}  // namespace kys_slam
