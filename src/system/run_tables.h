// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/map_snapshot.h>
#include <kys_slam/system.h>

#include <array>
#include <string>
#include <vector>

/// The tables and the cloud of a run's folder, as text (docs/reference.md describes them).
namespace kys_slam {

struct Stage {
  const char* name;
  double StageTimes::*value;
};
inline constexpr std::array<Stage, 10> kStages{{{"total", &StageTimes::total},
                                                {"extract", &StageTimes::extract},
                                                {"priors", &StageTimes::priors},
                                                {"stereo", &StageTimes::stereo},
                                                {"track", &StageTimes::track},
                                                {"predict", &StageTimes::predict},
                                                {"local_map", &StageTimes::local_map},
                                                {"local_mapping", &StageTimes::local_mapping},
                                                {"local_bundle", &StageTimes::local_bundle},
                                                {"loop", &StageTimes::loop}}};

std::string frames_csv(const System& system, const std::vector<FrameEstimate>& estimates);

/// A row per tracked frame and kind of relative pose. The upper triangle, row by row.
std::string covariance_csv(const System& system);

/// Keyframes that see the same landmarks, the spanning tree, and loops; keyframes by time stamp,
/// the later one first.
std::string graph_csv(const MapSnapshot& map);

/// Moving objects, a row per frame and object.
std::string objects_csv(const System& system, const std::string& label_space);

/// The landmarks of the trajectory's sub-map as binary PLY.
std::string map_ply(const MapSnapshot& map, const std::string& label_space);

}  // namespace kys_slam
