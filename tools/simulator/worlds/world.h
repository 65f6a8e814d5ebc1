// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "simulator/common/camera_model.h"
#include "simulator/worlds/scene.h"

namespace kys_slam::simulator {

enum class Layout { kKitti, kEuroc };

/// Options of a world.
struct WorldOptions {
  std::string name;
  std::uint64_t seed = 1;
  int frames = 0;  ///< 0: default of the world
  int width = 0;   ///< px; 0: size of the data set
  int height = 0;
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, WorldOptions& options);

/// A scene, the path of the camera through it, and the cameras.
struct World {
  std::string name;
  std::uint64_t seed = 0;
  Layout layout = Layout::kKitti;
  Scene scene;
  StereoRig rig;
  StereoCamera rectified;         ///< the pair after rectification (kKitti: as rendered)
  StereoRig truth_rig;            ///< rays of `rectified`, to which disparity and flow refer
  std::vector<double> times;      ///< s, from 0; one per frame
  std::vector<Rigid3> T_w_c;      ///< left camera, one per frame
  std::vector<Rigid3> T_w_b;      ///< kEuroc only: body
  std::vector<Rigid3> T_w_truth;  ///< left camera of truth_rig
};

/// Names of the worlds.
const std::vector<std::string>& world_names();
/// Builds a world.
/// \throws InputError for an unknown name (with the nearest known name) or invalid sizes.
World make_world(const WorldOptions& options);

/// Adds the calibration of KITTI 00, scaled to the requested size (one focal length, by width).
void set_kitti_rig(World& world, const WorldOptions& options);

World make_street(const WorldOptions& options);
World make_block(const WorldOptions& options);
World make_traffic(const WorldOptions& options);
World make_jam(const WorldOptions& options);
World make_hall(const WorldOptions& options);

}  // namespace kys_slam::simulator
