// A robot's program with a stereo camera of its own, reduced to what touches kys_slam: the camera
// drives along a wall it makes up. Exits with 0 when the poses are right.

#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>

namespace {

const kys_slam::StereoCamera kCamera{320, 240, 250, 250, 159.5, 119.5, 0.2};

Eigen::Vector3d position(int i) {
  return {0.05 * i, 0, 0.1 * i};
}

/// Grey value of the wall at z = 6 m and the floor below: blocks of several sizes.
double grey(double s, double t) {
  double value = 128;
  for (double size = 0.05; size < 1; size *= 2) {
    auto h = static_cast<std::uint64_t>(std::llround(std::floor(s / size)) * 1000003 +
                                        std::llround(std::floor(t / size)) * 7919 + size * 640);
    h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ull;
    h = (h ^ (h >> 27)) * 0x94D049BB133111EBull;
    value += 50 * (static_cast<double>(h >> 40) / (1 << 24) - 0.5);
  }
  return value;
}

double look(const Eigen::Vector3d& from, const Eigen::Vector3d& ray) {
  const double to_wall = (6 - from.z()) / ray.z();
  const double to_floor = ray.y() > 0 ? (1 - from.y()) / ray.y() : to_wall;
  const Eigen::Vector3d p = from + std::min(to_wall, to_floor) * ray;
  return to_floor < to_wall ? grey(p.x(), p.z() + 50) : grey(p.x(), p.y() - 50);
}

kys_slam::GrayImage take_picture(const Eigen::Vector3d& from) {
  kys_slam::GrayImage image(kCamera.width, kCamera.height);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      double value = 0;
      for (int k = 0; k < 9; ++k) {  // a pixel sees an area, not a point
        value += look(from, kCamera.back_project(x + (k % 3 - 1) / 3.0, y + (k / 3 - 1) / 3.0, 1));
      }
      image.at(x, y) = static_cast<std::uint8_t>(std::clamp(std::lround(value / 9), 0L, 255L));
    }
  }
  return image;
}

kys_slam::StereoFrame grab(int i) {
  kys_slam::StereoFrame frame;
  frame.index = i;
  frame.timestamp = 0.1 * i;
  frame.left = take_picture(position(i));
  frame.right = take_picture(position(i) + Eigen::Vector3d(kCamera.baseline, 0, 0));
  return frame;
}

int run() {
  constexpr int kFrames = 8;
  kys_slam::Settings settings = kys_slam::Settings::indoor();
  settings.set("orb.features", "600");
  kys_slam::System slam(kCamera, settings, kys_slam::Schedule::kPipelined);
  for (int i = 0; i < kFrames; ++i) {
    const kys_slam::FrameReport report = slam.feed(grab(i));
    if (report.status == kys_slam::FrameStatus::kLost) {
      std::fprintf(stderr, "consumer: frame %d lost: %s\n", i, report.reason.c_str());
      return 1;
    }
  }
  slam.finish();

  double worst = 0;
  for (const kys_slam::FrameEstimate& estimate : slam.trajectory()) {
    const Eigen::Vector3d truth = position(static_cast<int>(estimate.index));
    worst = std::max(worst, estimate.connected ? (estimate.T_w_c.t() - truth).norm() : 1e9);
  }
  std::printf("%zu keyframes, largest error %.4f m\n", slam.keyframes().size(), worst);
  return slam.trajectory().size() == kFrames && worst < 0.03 ? 0 : 1;
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
