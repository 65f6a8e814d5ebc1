// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/settings.h>
#include <kys_slam/system.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam::ros {

enum class Images : std::uint8_t { kAuto, kRectified };
enum class CameraPose : std::uint8_t { kParameters, kTf };
enum class Reliability : std::uint8_t { kBestEffort, kReliable };

/// The node's own parameters. All are read once, at the start.
struct NodeOptions {
  bool driving = false;
  std::string settings_file;
  Images images = Images::kAuto;
  std::string image_transport = "raw";
  Reliability reliability = Reliability::kBestEffort;
  double tolerance = 0.01;
  int queue = 10;
  double time_jump = 1;
  Schedule schedule = Schedule::kRealtime;
  std::string map_frame = "map", odom_frame = "odom", base_frame = "base_link", camera_frame;
  CameraPose camera_pose = CameraPose::kParameters;
  double camera_x = 0, camera_y = 0, camera_z = 0;
  double camera_roll = 0, camera_pitch = 0, camera_yaw = 0;
  bool publish_tf = true;
  int path_length = 1000;
  bool segments = false;
  int segment_divisor = 1000;
  std::string load_map;
  bool localize_only = false;
  std::string output;

  /// Of camera.x to camera.yaw.
  [[nodiscard]] Rigid3 T_base_camera() const;
};
void describe(kys::OptionList& list, NodeOptions& options);

/// A parameter as ROS declares it.
using Parameter = Settings::Description;
/// Of the node itself, with the defaults.
std::vector<Parameter> node_parameters();
/// The settings of the system, with the defaults of the kind of camera.
std::vector<Parameter> setting_parameters(bool driving);
/// "META (unit)", for ROS's descriptor; choices and texts with what they may be.
std::string description_of(const Parameter& parameter);

/// Value of a parameter as text; nothing: the user gave none.
using GivenValue = std::function<std::optional<std::string>(const Parameter&)>;
/// \throws InputError naming the parameter whose value is not in its range
NodeOptions read_options(const GivenValue& given);
/// Defaults, then the file, then the parameters that were given.
/// \throws InputError naming the setting that is not in its range, or the file
Settings read_settings(const NodeOptions& options, const GivenValue& given);

}  // namespace kys_slam::ros
