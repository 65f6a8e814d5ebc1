// SPDX-License-Identifier: BSD-3-Clause
// A robot's program with a stereo camera of its own, reduced to what touches kys_slam: the camera
// drives along a wall it makes up (wall.h). Exits with 0 when the poses are right.
#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <cstdio>

#include "wall.h"

namespace {

int run() {
  kys_slam::Settings settings = kys_slam::Settings::indoor();
  settings.set("orb.features", "600");
  kys_slam::System slam(wall::kCamera, settings, kys_slam::Schedule::kPipelined);
  for (int i = 0; i < wall::kFrames; ++i) {
    const kys_slam::FrameReport report = slam.feed(wall::grab(i));
    if (report.status == kys_slam::FrameStatus::kLost) {
      std::fprintf(stderr, "consumer: frame %d lost: %s\n", i, report.reason.c_str());
      return 1;
    }
  }
  slam.finish();

  double worst = 0;
  for (const kys_slam::FrameEstimate& estimate : slam.trajectory()) {
    const Eigen::Vector3d truth = wall::position(static_cast<int>(estimate.index));
    worst = std::max(worst, estimate.connected ? (estimate.T_w_c.t() - truth).norm() : 1e9);
  }
  std::printf("%zu keyframes, largest error %.4f m\n", slam.keyframes().size(), worst);
  return slam.trajectory().size() == wall::kFrames && worst < 0.03 ? 0 : 1;
}

}  // namespace

int main() {
  try {
    kys_slam::Settings().set("orb.featurs", "600");
    std::fprintf(stderr, "consumer: an unknown setting was taken\n");
    return 1;
  } catch (const kys_slam::InputError&) {
  }
  return run();
}
