// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "simulator/worlds/world.h"

namespace kys_slam::simulator {

/// Folders that hold images, relative to the sequence.
std::vector<std::filesystem::path> image_folders(const World& world);
/// Path of an image, relative to the sequence.
std::filesystem::path image_path(const World& world, int frame, int camera);
/// EuRoC: whether this frame of a camera is dropped (never the first and the last).
bool is_dropped(const World& world, int frame, int camera, int drop_camera, double drop_share);
/// Calibration, time stamps and true poses, in the format of the data set.
void write_layout_files(const World& world, const std::filesystem::path& folder, int drop_camera,
                        double drop_share);
std::string readme_text(const World& world, const std::string& command, bool with_truth);

}  // namespace kys_slam::simulator
