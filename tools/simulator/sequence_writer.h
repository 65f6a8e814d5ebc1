#pragma once

#include <kys/option_list.h>

#include <atomic>
#include <filesystem>
#include <string>

#include "world.h"

namespace kys_slam::simulator {

struct WriteOptions {
  std::filesystem::path output;
  std::string command;    ///< for the README of the sequence
  int jobs = 0;           ///< threads; 0: as many as the machine runs at once
  bool truth = true;      ///< disparity, flow, panoptic segments
  int drop_camera = -1;   ///< kEuroc: this camera loses frames
  double drop_share = 0;  ///< in [0, 1)
  bool quiet = false;
  const std::atomic<bool>* stop = nullptr;  ///< set: give up
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, WriteOptions& options);

/// What share of the left images objects that can move cover, on average over the frames; negative
/// when no truth was made.
struct SequenceFigures {
  double moving = -1;
  double standing = -1;
};

/// Renders all frames into `output`, which must not exist or be empty. Everything is made in
/// `output`.partial first, so that a folder of that name is always complete; on failure nothing is
/// left.
/// \throws InputError when the folder cannot be written or the disk is full, or when stopped.
SequenceFigures write_sequence(const World& world, const WriteOptions& options);

}  // namespace kys_slam::simulator
