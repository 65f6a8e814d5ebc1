// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/evaluation.h>

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "point_cloud.h"

namespace kys_slam {

/// m, of the shares that are stated.
inline constexpr std::array kNear = {0.02, 0.05, 0.10, 0.20};

/// A map to be evaluated.
struct EvaluatedMap {
  PointCloud cloud;
  /// Per point, m: from the keyframe of its range of distances; empty: not known.
  std::vector<double> distance;
  std::vector<TimedPose> keyframes;  ///< may be empty
};

/// Distances of some points, m.
struct Distances {
  std::string name;
  std::size_t count = 0;
  double median = 0, mean = 0, rmse = 0;
  std::array<double, kNear.size()> share{};  ///< 0..1, nearer than kNear
};

struct MapEvaluation {
  Similarity alignment;          ///< of map to truth, with that of ICP
  double spacing = 0;            ///< m, median distance of neighbours in the truth
  bool planes = false;           ///< the truth has normals
  std::vector<double> accuracy;  ///< per point of the map, m: distance from the truth
  Distances map_to_truth, truth_to_map;
  std::vector<Distances> by_distance, map_by_class, truth_by_class;
};

struct EvaluateOptions {
  std::vector<TimedPose> trajectory_truth;  ///< aligns by these
  std::optional<Rigid3> T_truth_map;        ///< the alignment
  bool scale = false;                       ///< with trajectories: of the map is free
  bool icp = false;                         ///< refines the alignment by the points
};

/// Accuracy (map to truth) and completeness (truth to map) with FLANN's kd-tree. Where the
/// truth has normals a distance is that from the plane of the nearest point, and what the points
/// are apart in it does not count. Classes are those of the truth where it has them, else of the
/// map. \throws InputError when trajectories do not overlap, or the map and the truth are apart
MapEvaluation evaluate_map(const EvaluatedMap& map, const PointCloud& truth,
                           const EvaluateOptions& options);

/// The map as PLY in the frame of the truth, green where its error is zero, red from 0.2 m on.
std::string error_ply(const EvaluatedMap& map, const MapEvaluation& evaluation);

}  // namespace kys_slam
