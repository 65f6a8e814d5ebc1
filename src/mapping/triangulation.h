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
  std::size_t neighbours = 5;        ///< covisible keyframes matched against
  double min_parallax_cos = 0.9998;  ///< rays of two monocular features must differ by more
  double scale_tolerance = 1.8;      ///< distance ratio against octave ratio, factor either way
  EpipolarOptions matching;
};
/// For check_options().
void describe(kys::OptionList& list, TriangulationOptions& options);

/// New landmarks from features of `current` and its best covisible keyframes that have none yet
/// (ORB-SLAM, Sec. VI-C; ORB-SLAM2: the wider of ray and stereo parallax gives the depth).
std::vector<LandmarkId> triangulate_landmarks(Map& map, KeyFrameId current,
                                              LandmarkIdAllocator& ids,
                                              const TriangulationOptions& options,
                                              const kys::DistanceModel& model,
                                              kys::Statistics& statistics);

}  // namespace kys_slam
