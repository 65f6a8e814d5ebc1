// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "priors/builder/build_sequence.h"

namespace kys_slam {

/// Opens a sequence folder for the builder. \param pair  parse_camera_pair's. \throws InputError.
BuildSequence open_build_sequence(const std::filesystem::path& folder,
                                  const std::string& pair = {});

/// Leaves `frames` (nullopt: all) of the sequence's frames from `start` on. \throws InputError when
/// `start` is beyond the last one.
void select_frames(BuildSequence& sequence, std::int64_t start, std::optional<std::int64_t> frames);

/// Checks that perception outputs were made from the images of the selected pair. `input` is a
/// folder of perception outputs; tools/perception writes the name of the image folder to its
/// images.txt. \throws InputError when that is another one of image_0 to image_3 than `images`.
void check_made_of(const std::filesystem::path& input, const std::string& images);

}  // namespace kys_slam
