// SPDX-License-Identifier: BSD-3-Clause
// Reads a prior file and writes it again, without tolerance: for tests of other implementations.
#include <kys_slam/prior_writer.h>
#include <kys_slam/util/atomic_file.h>

#include <iostream>

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  try {
    const kys_slam::FramePriors priors = decode_priors(kys_slam::PriorFile::open(argv[1]));
    kys_slam::write_file_atomic(
        argv[2], std::span<const std::uint8_t>(encode_priors(
                     priors, argv[2], {.tolerance_steps = 0, .keep_sides = {8, 20}})));
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 2;
  }
  return 0;
}
