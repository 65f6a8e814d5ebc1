// SPDX-License-Identifier: BSD-3-Clause
#include "run_program.h"

int main(int argc, char** argv) {
  kys_slam::RunProgram program;
  program.name = "run_stereo_euroc";
  program.description =
      "Stereo SLAM on a sequence in EuRoC's layout (mav0/cam0, mav0/cam1); images are rectified by "
      "the program, cameras are paired by time stamp. Or on a feature file.";
  program.settings = kys_slam::Settings::indoor();
  program.open = kys_slam::open_euroc_sequence;
  return kys_slam::run_program(std::move(program), argc, argv);
}
