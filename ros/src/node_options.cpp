// SPDX-License-Identifier: BSD-3-Clause
#include "node_options.h"

#include <kys_slam/error.h>

#include <numbers>

#include "frames.h"

namespace kys_slam::ros {

Rigid3 NodeOptions::T_base_camera() const {
  return base_from_camera({camera_x, camera_y, camera_z}, {camera_roll, camera_pitch, camera_yaw});
}

void describe(kys::OptionList& list, NodeOptions& o) {
  constexpr double kFar = 100, kTurn = 2 * std::numbers::pi;
  list.add("driving", o.driving,
           "settings start from the defaults of a vehicle, not from those of an indoor camera");
  list.add("settings_file", o.settings_file, "YAML file of settings; the parameters count more");
  list.add("images", o.images, {"auto", "rectified"},
           "auto: the node rectifies images unless camera_info describes a rectified pair; "
           "rectified: they are rectified by P of camera_info, whatever D says");
  list.add("image_transport", o.image_transport, "raw, compressed, or another image_transport");
  list.add("reliability", o.reliability, {"best_effort", "reliable"},
           "of the subscriptions of images");
  list.add("tolerance", o.tolerance, {0, 1}, "s", "largest time difference of a pair");
  list.add("queue", o.queue, {1, 1000}, "images",
           "of a side that wait for a partner, and pairs that wait to be tracked");
  list.add("time_jump", o.time_jump, {0.001, 1e6}, "s",
           "back in time, from which the run starts again");
  list.add("schedule", o.schedule, {"sequential", "pipelined", "realtime"},
           "when the back end runs; results of realtime depend on the speed of the machine");
  list.add("map_frame", o.map_frame, "name of a frame");
  list.add("odom_frame", o.odom_frame, "name of a frame");
  list.add("base_frame", o.base_frame, "name of a frame");
  list.add(
      "camera_frame", o.camera_frame,
      "optical frame of the left camera. With camera_pose parameters it is published as static "
      "transform, empty: not published; with tf it is looked up, empty: that of the images");
  list.add("camera_pose", o.camera_pose, {"parameters", "tf"},
           "where the left camera is on the robot: camera.x to camera.yaw, or the transform from "
           "base_frame to the camera's optical frame at the start");
  list.add("camera.x", o.camera_x, {-kFar, kFar}, "m", "position of the left camera in base_link");
  list.add("camera.y", o.camera_y, {-kFar, kFar}, "m", "position of the left camera in base_link");
  list.add("camera.z", o.camera_z, {-kFar, kFar}, "m", "position of the left camera in base_link");
  list.add("camera.roll", o.camera_roll, {-kTurn, kTurn}, "rad",
           "of the camera's axes (x forward, z up) in base_link");
  list.add("camera.pitch", o.camera_pitch, {-kTurn, kTurn}, "rad", "positive: it looks down");
  list.add("camera.yaw", o.camera_yaw, {-kTurn, kTurn}, "rad", "positive: it looks to the left");
  list.add("publish_tf", o.publish_tf, "map to odom and odom to base_link");
  list.add("path_length", o.path_length, {0, 1000000}, "poses", "of the topic path, the last ones");
  list.add(
      "segments", o.segments,
      "label images come on the topic segments: mode verified, and a map starts with the first "
      "of them, unless kys.mode and control.segment_every say otherwise");
  list.add("segment_divisor", o.segment_divisor, {1, 1000000}, "",
           "label images hold class * divisor + instance");
  list.add("load_map", o.load_map, "file of a saved map to start in");
  list.add("localize_only", o.localize_only, "the loaded map does not change");
  list.add("output", o.output, "folder of the results, written at the end; empty: none");
}

namespace {

Parameter parameter_of(const kys::Option& option) {
  Parameter p;
  p.key = option.key;
  p.value = option.text();
  p.unit = option.unit;
  p.meaning = option.meaning;
  p.range = option.range_text();
  using Type = Settings::Type;
  if (std::holds_alternative<bool*>(option.value)) p.type = Type::kTruth;
  if (std::holds_alternative<int*>(option.value)) p.type = Type::kInteger;
  if (std::holds_alternative<double*>(option.value)) p.type = Type::kReal;
  if (const auto* choice = std::get_if<kys::OptionChoice>(&option.value)) {
    p.type = Type::kChoice;
    p.choices.assign(choice->names.begin(), choice->names.end());
  }
  p.least = option.range.least;
  p.most = option.range.most;
  return p;
}

Settings defaults(bool driving) {
  return driving ? Settings() : Settings::indoor();
}

}  // namespace

std::vector<Parameter> node_parameters() {
  NodeOptions options;
  kys::OptionList list;
  describe(list, options);
  std::vector<Parameter> all;
  for (const kys::Option& option : list.options()) all.push_back(parameter_of(option));
  return all;
}

std::vector<Parameter> setting_parameters(bool driving) {
  return defaults(driving).describe();
}

std::string description_of(const Parameter& parameter) {
  std::string text = parameter.meaning;
  if (!parameter.unit.empty()) text += " (" + parameter.unit + ")";
  if (parameter.type != Settings::Type::kChoice) return text;
  text += "; one of";
  for (const std::string& choice : parameter.choices) text += " " + choice;
  return text;
}

NodeOptions read_options(const GivenValue& given) {
  NodeOptions options;
  kys::OptionList list;
  describe(list, options);
  for (const kys::Option& option : list.options()) {
    const std::optional<std::string> text = given(parameter_of(option));
    if (text && !option.parse(*text)) {
      throw InputError("parameter " + option.key + " is '" + *text + "', not " + option.expected());
    }
    if (const std::string complaint = option.complaint(); !complaint.empty()) {
      throw InputError("parameter " + complaint);
    }
  }
  if (options.map_frame == options.odom_frame || options.odom_frame == options.base_frame ||
      options.map_frame == options.base_frame) {
    throw InputError("parameters map_frame, odom_frame and base_frame need different names");
  }
  const bool is_placed = options.camera_x != 0 || options.camera_y != 0 || options.camera_z != 0 ||
                         options.camera_roll != 0 || options.camera_pitch != 0 ||
                         options.camera_yaw != 0;
  if (options.camera_pose == CameraPose::kTf && is_placed) {
    throw InputError("parameters camera.x to camera.yaw are not used with camera_pose tf");
  }
  if (options.localize_only && options.load_map.empty()) {
    throw InputError("parameter localize_only needs load_map");
  }
  return options;
}

Settings read_settings(const NodeOptions& options, const GivenValue& given) {
  Settings settings = defaults(options.driving);
  if (options.segments) {
    settings.set("kys.mode", "verified");
    settings.set("control.segment_every", "1");  // a map starts with segments
  }
  if (!options.settings_file.empty()) settings.load(options.settings_file);
  for (const Parameter& parameter : setting_parameters(options.driving)) {
    if (const auto text = given(parameter)) settings.set(parameter.key, *text);
  }
  settings.check();
  return settings;
}

}  // namespace kys_slam::ros
