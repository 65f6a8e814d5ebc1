// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace kys_slam {

/// Whether an image's stem is one of Virtual KITTI 2.
inline bool is_vkitti_frame(const std::string& name) {
  return name.starts_with("rgb_");
}

/// Virtual KITTI 2 names the files of a frame by their content: rgb_00012.jpg, depth_00012.png,
/// flow_00012.png, backwardFlow_00013.png, instancegt_00012.png, classgt_00012.png. This is the
/// file of the frame whose image has the stem `name`.
inline std::string vkitti_name(const std::string& prefix, const std::string& name) {
  return prefix + (is_vkitti_frame(name) ? name.substr(4) : name) + ".png";
}

/// Whether a file is one of the instance images.
inline bool is_vkitti_instances(const std::filesystem::path& file) {
  return file.filename().string().starts_with("instancegt_");
}

/// Whether a file is one of the depth or flow images.
inline bool is_vkitti_field(const std::filesystem::path& file) {
  const std::string name = file.filename().string();
  return name.starts_with("depth_") || name.starts_with("flow_") ||
         name.starts_with("backwardFlow_");
}

}  // namespace kys_slam
