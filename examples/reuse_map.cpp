// SPDX-License-Identifier: BSD-3-Clause
// Makes a map of one sequence and finds the frames of another in it: reuse_map FIRST SECOND
// TOWN.map
#include <kys_slam/error.h>
#include <kys_slam/frame_input.h>
#include <kys_slam/system.h>

#include <cstdio>
#include <string>

namespace {

/// Tracks a sequence, in the map of a file if one is given, and returns the frames with a pose.
int track(const std::string& sequence, const std::string& load, const std::string& save) {
  const kys_slam::FrameInput input = kys_slam::open_frame_input(sequence, {});
  kys_slam::System slam(input.frames->camera(), kys_slam::Settings(),
                        kys_slam::Schedule::kPipelined);
  if (!load.empty()) slam.load_map(load, /*localize_only=*/true);
  while (const auto frame = input.frames->next()) slam.feed(*frame);
  slam.finish();
  if (!save.empty()) slam.save_map(save);
  int placed = 0;
  for (const kys_slam::FrameEstimate& estimate : slam.trajectory()) placed += estimate.connected;
  const kys_slam::MapSnapshot map = slam.snapshot();
  std::printf("%s: %d frames with a pose; map of %zu keyframes, %zu landmarks\n", sequence.c_str(),
              placed, map.keyframes.size(), map.landmarks.size());
  return placed;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 4) {
    std::fprintf(stderr, "usage: reuse_map FIRST SECOND TOWN.map\n");
    return 2;
  }
  track(argv[1], "", argv[3]);
  return track(argv[2], argv[3], "") > 0 ? 0 : 3;
} catch (const kys_slam::InputError& error) {
  std::fprintf(stderr, "reuse_map: %s\n", error.what());
  return 2;
}
