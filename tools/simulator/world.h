#pragma once

#include <kys/option_list.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "camera_model.h"
#include "scene.h"

namespace kys_slam::simulator {

enum class Layout { kKitti, kEuroc };

/// What a user asks for.
struct WorldOptions {
  std::string name;
  std::uint64_t seed = 1;
  int frames = 0;  ///< 0: the world's own length
  int width = 0;   ///< px; 0: the data set's own size
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
  StereoCamera rectified;         ///< the pair as its reader rectifies it (kKitti: as it is)
  StereoRig truth_rig;            ///< `rectified` as rays: what disparity and flow refer to
  std::vector<double> times;      ///< s, from 0; one per frame
  std::vector<Rigid3> T_w_c;      ///< left camera, one per frame
  std::vector<Rigid3> T_w_b;      ///< kEuroc only: body
  std::vector<Rigid3> T_w_truth;  ///< left camera of truth_rig
};

/// Names of the worlds.
const std::vector<std::string>& world_names();
/// Builds a world.
/// \throws InputError for an unknown name (naming the nearest) or sizes that make no sense.
World make_world(const WorldOptions& options);

/// Adds KITTI 00's calibration, scaled to the size asked for (one focal length: by width).
void set_kitti_rig(World& world, const WorldOptions& options);

World make_street(const WorldOptions& options);
World make_block(const WorldOptions& options);
World make_traffic(const WorldOptions& options);
World make_jam(const WorldOptions& options);
World make_hall(const WorldOptions& options);

}  // namespace kys_slam::simulator
