// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>
#include <kys_slam/prior_writer.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace kys_slam {

/// Errors of a motion detector: of its decisions, not of its pixels.
enum class DecisionError {
  kParked,        ///< every vehicle, parked ones too, is called moving
  kBlind,         ///< nothing is called moving
  kDrop,          ///< 30 % of the files are missing, in runs of 1 to 8 frames
  kFlip,          ///< per instance and interval of 10 frames, wrong with probability 0.3
  kLate,          ///< every file is from the frame before; the first frame has none
  kBleed,         ///< moving segments are 8 px too large
  kSegmentsOnly,  ///< motion was not judged at all
};

/// Names: "parked", "blind", "drop", "flip", "late", "bleed", "segments-only".
/// \throws InputError for another name.
DecisionError parse_decision_error(const std::string& word);
const std::vector<std::string>& decision_error_names();

/// Counts of changes in a folder.
struct DecisionErrorCounts {
  std::size_t files = 0, written = 0;  ///< prior files read, and written
  std::size_t things = 0;              ///< thing segments, both cameras, of all files read
  std::size_t moving_before = 0, moving_after = 0;  ///< of these, flagged as moving
};

/// Frames whose files are kept, true for each. 30 % (rounded) are dropped, in separate runs of 1 to
/// 8 frames.
std::vector<bool> kept_frames(std::size_t frames, std::uint64_t seed);

/// Flags a segment as moving (score and mu 100) or as not moving.
void set_moving(CameraPriors& camera, std::size_t segment, bool moving);

/// Dilates the segments flagged as moving by `radius` px (Euclidean). A pixel is assigned to the
/// nearest one and gets its mu. Scales grow with the areas.
void grow_moving_segments(CameraPriors& camera, int radius);

/// Adds one kind of error to the prior files of a folder. The same seed gives the same bytes.
/// \param folder  prior files, one per frame, in order of name
/// \param output  must not contain prior files
/// \param label_space  of the files, by name or path; "": the built-in one that they name, which
///   kParked needs
/// \throws InputError for files that cannot be read or written, or are of another label space.
DecisionErrorCounts disturb_decisions(const std::filesystem::path& folder,
                                      const std::filesystem::path& output, DecisionError error,
                                      std::uint64_t seed, const std::string& label_space = {});

}  // namespace kys_slam
