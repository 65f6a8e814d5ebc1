#pragma once

#include <filesystem>
#include <string>

namespace kys_slam {

/// Virtual KITTI 2 names a frame's files by what they hold: rgb_00012.jpg, depth_00012.png,
/// flow_00012.png, backwardFlow_00013.png, instancegt_00012.png, classgt_00012.png. This is the
/// file of the frame whose image has the stem `name`.
inline std::string vkitti_name(const std::string& prefix, const std::string& name) {
  return prefix + (name.starts_with("rgb_") ? name.substr(4) : name) + ".png";
}

/// Whether a file is one of the instance pictures.
inline bool is_vkitti_instances(const std::filesystem::path& file) {
  return file.filename().string().starts_with("instancegt_");
}

}  // namespace kys_slam
