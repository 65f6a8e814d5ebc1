// SPDX-License-Identifier: BSD-3-Clause
// A raw stereo camera of one's own: own_camera CALIBRATION.yaml LEFT.png RIGHT.png ...
// The images stand for a driver's buffers.
#include <kys_slam/check_pair.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_view.h>
#include <kys_slam/prior_provider.h>
#include <kys_slam/stereo_rig.h>
#include <kys_slam/system.h>

#include <cstdio>

namespace {

/// Priors from memory: here, everything in the lower half is ground (class 100, "pavement").
class GroundPriors : public kys_slam::PriorProvider {
 public:
  bool look_up(const kys_slam::StereoFrame& frame, std::span<const kys_slam::Keypoint> left,
               std::span<const kys_slam::Keypoint> right, std::vector<kys::Prior>& left_priors,
               std::vector<kys::Prior>& right_priors) override {
    const auto half = static_cast<float>(frame.left.height()) / 2;
    left_priors.assign(left.size(), {});
    right_priors.assign(right.size(), {});
    for (std::size_t i = 0; i < left.size(); ++i)
      left_priors[i].label = left[i].y > half ? 100 : 119;
    for (std::size_t i = 0; i < right.size(); ++i)
      right_priors[i].label = right[i].y > half ? 100 : 119;
    return true;
  }
};

}  // namespace

int main(int argc, char** argv) try {
  const std::filesystem::path calibration[] = {argc > 1 ? argv[1] : "camchain.yaml"};
  const kys_slam::StereoRig rig = kys_slam::read_stereo_rig(calibration);
  const kys_slam::StereoRectifier rectifier(rig.left, rig.right, rig.name);
  kys_slam::Settings settings = kys_slam::Settings::indoor();
  settings.set("kys.mode", "kys");
  kys_slam::System slam(rectifier.camera(), settings, kys_slam::Schedule::kPipelined,
                        std::make_unique<GroundPriors>());
  for (int i = 2; i + 1 < argc; i += 2) {
    kys_slam::StereoFrame frame;
    frame.timestamp = 0.05 * i;  // s
    frame.left = rectifier.rectify_left(kys_slam::read_gray(argv[i]));
    frame.right = rectifier.rectify_right(kys_slam::read_gray(argv[i + 1]));
    if (i == 2) std::puts(kys_slam::check_stereo_pair(frame.left, frame.right).problem.c_str());
    const kys_slam::FrameReport report = slam.feed(frame);
    std::printf("%s: %d landmarks\n", kys_slam::to_string(report.status), report.inliers);
  }
  slam.finish();
  return 0;
} catch (const kys_slam::InputError& error) {
  std::fprintf(stderr, "own_camera: %s\n", error.what());
  return 2;
}
