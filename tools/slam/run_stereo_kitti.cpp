// SPDX-License-Identifier: BSD-3-Clause
#include "run_program.h"

int main(int argc, char** argv) {
  kys_slam::RunProgram program;
  program.name = "run_stereo_kitti";
  program.description =
      "Stereo SLAM on a sequence of KITTI odometry (image_0/1 or image_2/3), KITTI Tracking "
      "(training/image_02/0001) or Virtual KITTI 2 (Scene01/clone), or on a feature file.";
  program.open = kys_slam::open_kitti_sequence;
  return kys_slam::run_program(std::move(program), argc, argv);
}
