// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>
#include <kys_slam/sequence.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

class Settings;

/// Opens a sequence folder of one layout.
using OpenSequence =
    std::function<std::unique_ptr<Sequence>(const std::filesystem::path&, const SequenceOptions&)>;

/// Input of a run: the images of a folder or the features of a file.
struct FrameInput {
  std::string name;    ///< for the output folder
  std::string layout;  ///< "KITTI odometry", "EuRoC", .., "features"
  std::unique_ptr<FrameSource> frames;
  std::vector<TimedPose> ground_truth;  ///< left camera; empty: none
  bool has_images = true;               ///< false: features, whose octaves are the file's
  double scale_factor = 0;              ///< of a feature file, between two octaves
  int levels = 0;                       ///< of a feature file
  std::string label_space;              ///< of the priors in a feature file; "": no priors
  /// Distinguishes recordings of one name: "frame I: DIGEST" of the first frame of the part that is
  /// used, its time stamp and left image. "": not known.
  std::string recording;
  std::vector<std::string> notes;                ///< warnings for the user (Sequence::notes)
  std::map<std::string, std::int64_t> left_out;  ///< counts of what was not used, by what it is
};

/// Opens a sequence folder with `open_folder` (`open_sequence`: any layout) or a feature file
/// (tools/simulator/features/README.md). The first bytes identify a feature file, not its name.
/// \throws InputError naming the path: neither, unreadable, damaged, no frames in the requested
/// part.
FrameInput open_frame_input(const std::filesystem::path& path, const SequenceOptions& options,
                            const OpenSequence& open_folder = open_sequence);

/// A sequence that is open as the input of a run.
/// \param start  number of its first frame in the whole sequence
FrameInput frame_input_of(std::unique_ptr<Sequence> sequence, std::int64_t start);

/// \throws InputError when the octaves of a feature file or the label space of its priors differ
/// from those in `settings`.
void check_features(const FrameInput& input, const Settings& settings,
                    const std::filesystem::path& path);

}  // namespace kys_slam
