// SPDX-License-Identifier: BSD-3-Clause
// Tracks a recorded sequence of any layout: track_sequence SEQUENCE OUT.tum
#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/frame_input.h>
#include <kys_slam/read_ahead.h>
#include <kys_slam/system.h>
#include <kys_slam/trajectory_file.h>

#include <cstdio>

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::fprintf(stderr, "usage: track_sequence SEQUENCE OUT.tum\n");
    return 2;
  }
  const kys_slam::FrameInput input = kys_slam::open_frame_input(argv[1], {});
  const kys_slam::Settings settings =
      input.layout == "EuRoC" ? kys_slam::Settings::indoor() : kys_slam::Settings();
  kys_slam::System slam(input.frames->camera(), settings, kys_slam::Schedule::kPipelined);

  kys_slam::ReadAhead frames(*input.frames);  // decodes beside tracking
  while (const auto frame = frames.next()) {
    const kys_slam::FrameReport report = slam.feed(*frame);
    if (report.status == kys_slam::FrameStatus::kLost) {
      std::printf("frame %s: lost, %s\n", report.name.c_str(), report.reason.c_str());
    }
  }
  slam.finish();

  std::vector<kys_slam::TimedPose> poses;
  for (const kys_slam::FrameEstimate& estimate : slam.trajectory()) {
    if (estimate.connected) poses.push_back({estimate.timestamp, estimate.T_w_c});
  }
  kys_slam::write_tum_poses(argv[2], poses);
  if (!input.ground_truth.empty()) {
    const kys_slam::Evaluation result = kys_slam::evaluate(input.ground_truth, poses);
    std::printf("ATE %.3f m over %.1f m\n", result.ate.rmse, result.reference_length);
  }
  return 0;
} catch (const kys_slam::InputError& error) {
  std::fprintf(stderr, "track_sequence: %s\n", error.what());
  return 2;
}
