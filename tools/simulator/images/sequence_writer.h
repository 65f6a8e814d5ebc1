// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>

#include "simulator/worlds/world.h"

namespace kys_slam::simulator {

struct WriteOptions {
  std::filesystem::path output;
  std::string command;              ///< for the README of the sequence
  int jobs = 0;                     ///< threads; 0: one per processor
  bool truth = true;                ///< disparity, flow, panoptic segments
  int drop_camera = -1;             ///< kEuroc: camera whose frames are dropped
  double drop_share = 0;            ///< 0 to 0.9
  std::int64_t surface_points = 0;  ///< written to surface.ply; 0: none
  bool quiet = false;
  const std::atomic<bool>* stop = nullptr;  ///< if set, stop
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, WriteOptions& options);

/// Mean share of the left images covered by objects that can move: moving, and static ones.
/// Negative without ground truth.
struct SequenceFigures {
  double moving = -1;
  double standing = -1;
};

/// Renders all frames to `output`, which must not exist or be empty. Files are written to
/// `output`.partial, which is renamed at the end, so that `output` is always complete. On failure
/// it is removed.
/// \throws InputError when the folder cannot be written or the disk is full, or when stopped.
SequenceFigures write_sequence(const World& world, const WriteOptions& options);

}  // namespace kys_slam::simulator
