// SPDX-License-Identifier: BSD-3-Clause
// A program that uses the prior builder, reduced to its options. Exits with 0 when a missing file
// is an error.
#include <kys_slam/error.h>
#include <priors/builder/options_file.h>

#include <cstdio>

int main() {
  try {
    kys_slam::BuilderOptions options;
    kys_slam::load_options("/nowhere/priors.yaml", options);
  } catch (const kys_slam::InputError&) {
    return 0;
  }
  std::fprintf(stderr, "builder: a missing file was taken\n");
  return 1;
}
