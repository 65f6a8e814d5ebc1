// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "simulator/common/camera_model.h"
#include "simulator/common/rig_error.h"
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
  std::array<double, 2> blur{};       ///< px, left and right camera: sigma of the image of a point
  double exposure_difference = 0.01;  ///< share by which right images are darker
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, WorldOptions& options);

/// A scene, the path of the camera through it, and the cameras.
struct World {
  std::string name;
  std::uint64_t seed = 0;
  Layout layout = Layout::kKitti;
  std::array<double, 2> blur{};       ///< as in WorldOptions
  double exposure_difference = 0.01;  ///< likewise
  Scene scene;
  StereoRig rig;
  StereoCamera rectified;             ///< the pair after rectification (kKitti: as rendered)
  StereoRig truth_rig;                ///< rays of `rectified`, to which disparity and flow refer
  std::vector<double> times;          ///< s, from 0; one per frame
  std::vector<Rigid3> T_w_c;          ///< left camera, one per frame
  std::vector<Rigid3> T_w_b;          ///< kEuroc only: body
  std::vector<Rigid3> T_w_truth;      ///< left camera of truth_rig
  std::optional<RigError> rig_error;  ///< if requested: what `rectified` does not say of the rigs

  /// False when an error of the rig bends the views that the truth refers to.
  [[nodiscard]] bool is_rectified() const { return !rig_error || *rig_error == RigError{}; }
};

/// Names of the worlds.
const std::vector<std::string>& world_names();
/// Builds a world.
/// \throws InputError for an unknown name (with the nearest known name) or invalid sizes.
World make_world(const WorldOptions& options);

/// Replaces the cameras by those that the calibration of the world does not know exactly. The error
/// is that of the rectified pair: raw images are such that a reader who rectifies them by their
/// calibration gets the images of the pair with this error.
/// \throws InputError as TruePair
void apply_rig_error(World& world, const RigError& error);

/// Adds the calibration of KITTI 00, scaled to the requested size (one focal length, by width).
void set_kitti_rig(World& world, const WorldOptions& options);

World make_street(const WorldOptions& options);
World make_block(const WorldOptions& options);
World make_traffic(const WorldOptions& options);
World make_jam(const WorldOptions& options);
World make_hall(const WorldOptions& options);

}  // namespace kys_slam::simulator
