#pragma once

#include <kys/label_space.h>
#include <kys_slam/prior_writer.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace kys_slam {

/// What a motion detector gets wrong as a whole: errors of its decisions, not of its pixels.
enum class DecisionError {
  kParked,        ///< every vehicle, parked ones too, is called moving
  kBlind,         ///< nothing is called moving
  kDrop,          ///< 30 % of the files are missing, in runs of 1 to 8 frames
  kFlip,          ///< per instance and interval of 10 frames, wrong with probability 0.3
  kLate,          ///< every file is that of the frame before; the first frame has none
  kBleed,         ///< moving segments are 8 px too large
  kSegmentsOnly,  ///< motion was not judged at all
};

/// Spells them: "parked", "blind", "drop", "flip", "late", "bleed", "segments-only".
/// \throws InputError for another word.
DecisionError parse_decision_error(const std::string& word);
const std::vector<std::string>& decision_error_names();

/// What was done to a folder.
struct DecisionErrorCounts {
  std::size_t files = 0, written = 0;  ///< prior files read, and left in the output
  std::size_t things = 0;              ///< thing segments, both cameras, of all files read
  std::size_t moving_before = 0, moving_after = 0;  ///< of these, called moving
};

/// Frames that are kept: 30 % (rounded) are not, in runs of 1 to 8 that do not touch.
std::vector<bool> kept_frames(std::size_t frames, std::uint64_t seed);

/// Calls a segment moving, as sure as can be (score and mu 100), or not moving.
void set_moving(CameraPriors& camera, std::size_t segment, bool moving);

/// Lets segments that are called moving cover what is within `radius` px of them (Euclidean); the
/// nearest one wins, and pixels take over its mu. Scales grow with the areas.
void grow_moving_segments(CameraPriors& camera, int radius);

/// Puts one kind of error into the prior files of a folder. Same seed, same bytes.
/// \param folder  prior files, one per frame, in order of name
/// \param output  must not have prior files in it
/// \throws InputError for files that cannot be read or written.
DecisionErrorCounts disturb_decisions(const std::filesystem::path& folder,
                                      const std::filesystem::path& output, DecisionError error,
                                      std::uint64_t seed);

}  // namespace kys_slam
