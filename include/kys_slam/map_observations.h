// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rig_correction.h>
#include <kys_slam/rigid3.h>

#include <cstdint>
#include <filesystem>
#include <vector>

namespace kys_slam {

/// What the keyframes of a saved map measured, with the map's poses and landmarks: the input of
/// adjustments with more free parameters than the map has.
struct MapObservations {
  struct Observation {
    /// px of the left and right image as given; without a column: left image alone, without a row:
    /// not measured
    RigCorrection::Measured measured;
    std::uint32_t keyframe = 0;  ///< index in T_c_w
    float scale = 1;             ///< px of level 0 per px of the octave
    float inv_sigma = 1;         ///< 1/px, of u
  };
  StereoCamera camera;                     ///< the given calibration
  RigEstimate rig;                         ///< the correction in the map
  double information_v = 1;                ///< of v over that of u
  double information_disparity = 1;        ///< of the disparity over that of u
  std::vector<Rigid3> T_c_w;               ///< of keyframes, by id
  std::vector<std::uint8_t> held;          ///< per keyframe: 1 for one of every sub-map
  std::vector<Eigen::Vector3d> landmarks;  ///< p_w, m
  std::vector<Observation> observations;   ///< by landmark
  std::vector<std::int32_t> first{0};  ///< per landmark its first observation; then their number

  std::vector<std::uint32_t> keyframe_ids;  ///< per keyframe, increasing
  std::vector<std::uint32_t> submaps;       ///< per keyframe: id of the first one of its sub-map
  std::vector<double> timestamps;           ///< per keyframe, s
  std::vector<std::uint32_t> landmark_ids;  ///< per landmark, increasing
};

/// Which part of a map to read.
struct MapSelection {
  std::size_t keyframes = 100;       ///< at most; the newest
  std::size_t observations = 30000;  ///< about, at most
  int min_observers = 3;             ///< keyframes that observe a landmark
  /// px of level 0 per px of the octave, of disparities that are used: coarser ones are biased to
  /// the nearer of two surfaces, which matters when a rig is estimated.
  float coarsest_disparity = 1.5F;

  /// All keyframes, all landmarks that two of them observe, all disparities.
  static MapSelection all() { return {std::size_t{1} << 30, std::size_t{1} << 40, 2, 1e9F}; }
};

/// Reads a saved map, of any label space.
/// \throws InputError naming the file: no map, damaged, or too little in it
MapObservations read_map_observations(const std::filesystem::path& file,
                                      const MapSelection& selection = {});

}  // namespace kys_slam
