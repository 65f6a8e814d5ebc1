// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_input.h>
#include <kys_slam/settings.h>

#include <string>

namespace kys_slam {

/// Properties of one of the run_stereo programs.
struct RunProgram {
  std::string name;
  std::string description;
  Settings settings;  ///< defaults for this kind of sequence
  OpenSequence open;  ///< folders; feature files are the same for all programs
};

/// The whole program: command line, run, output. Returns the exit status: 0, 2 for bad usage or
/// input, 3 when tracking failed.
int run_program(RunProgram program, int argc, char** argv);

}  // namespace kys_slam
