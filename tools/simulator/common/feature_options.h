// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/feature_file.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "simulator/common/rig_error.h"

namespace kys_slam::simulator {

/// Amount of traffic in a simulated drive.
enum class Traffic : std::uint8_t { kNone, kLight, kCity, kJam };

/// How features are simulated along a trajectory.
struct FeatureOptions {
  std::uint64_t seed = 1;
  std::string camera = "auto";  ///< kitti, euroc, auto: kitti for KITTI files, euroc for TUM files
  std::int64_t start = 0;       ///< first pose used
  std::int64_t frames = -1;     ///< poses used; -1: all
  std::int64_t every = 1;       ///< use every N-th pose of the file, from the first
  int features =
      0;  ///< approximate number per image; 0: default of the camera (kitti 2000, euroc 1200)
  double pixel_noise = 0.25;  ///< sigma at octave 0, px; grows with the octave's scale
  double wander = 0.2;        ///< px, octave 0, viewpoint-dependent shift of a corner
  double lens = 0.2;          ///< px, residual lens distortion after calibration
  double bit_noise = 0.05;    ///< probability that a bit of a descriptor flips
  double outliers = 0.55;     ///< share of features that are never observed again
  double dropout = 0.4;       ///< share of visible landmarks that a camera does not detect
  double repeats = 0.10;      ///< share of landmarks that share a descriptor with others
  double rate = 10;           ///< Hz, for trajectories without time stamps
  double frame_rate = 1e4;   ///< Hz; poses between the frames are left out, see read_feature_path()
  double near = 0, far = 0;  ///< m, range of depths; 0: defaults of the camera (4-60, 0.8-12)
  Traffic traffic = Traffic::kNone;    ///< moving and parked objects
  std::vector<FeatureObject> objects;  ///< replace the traffic; same frames (read_objects)
  int width = 0;                       ///< px, of KITTI images; scales the camera; 0: 1241
  std::optional<RigError> rig_error;   ///< of the cameras that take the pictures
  bool labelled = false;  ///< every landmark has a class, for perception; traffic implies it
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, FeatureOptions& options);

/// True when a world with these options has objects with landmarks of their own.
bool has_traffic(const FeatureOptions& options);

}  // namespace kys_slam::simulator
