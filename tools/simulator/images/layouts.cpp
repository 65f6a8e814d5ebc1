// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/layouts.h"

#include <fmt/printf.h>
#include <kys_slam/util/atomic_file.h>

#include <cinttypes>
#include <cmath>

#include "simulator/common/euroc_rig.h"
#include "simulator/common/rng.h"

namespace kys_slam::simulator {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kStartNs = 1700000000000000000;

std::int64_t stamp_ns(const World& world, int frame) {
  return kStartNs + std::llround(world.times[static_cast<std::size_t>(frame)] * 1e9);
}

void write_kitti(const World& world, const fs::path& folder) {
  std::string poses;
  std::string times;
  const Rigid3 T_0_w = world.T_w_c.front().inverse();
  for (std::size_t i = 0; i < world.times.size(); ++i) {
    const Eigen::Matrix<double, 3, 4> M = (T_0_w * world.T_w_c[i]).matrix();
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 4; ++c) {
        poses += fmt::sprintf("%.12e%s", M(r, c), r == 2 && c == 3 ? "\n" : " ");
      }
    }
    times += fmt::sprintf("%.6e\n", world.times[i]);
  }
  write_file_atomic(folder / "poses.txt", poses);
  write_file_atomic(folder / "times.txt", times);
  const StereoCamera& k = world.rectified;
  std::string calib;
  for (int i = 0; i < 2; ++i) {
    calib += fmt::sprintf(
        "P%d: %.12e %.12e %.12e %.12e %.12e %.12e %.12e %.12e %.12e %.12e %.12e %.12e\n", i, k.fx,
        0.0, k.cx, i == 0 ? 0.0 : -k.bf(), 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0);
  }
  write_file_atomic(folder / "calib.txt", calib);
}

void write_euroc(const World& world, const fs::path& folder, int drop_camera, double drop_share) {
  const int count = static_cast<int>(world.times.size());
  for (int camera = 0; camera < 2; ++camera) {
    std::string list = "#timestamp [ns],filename\n";
    for (int i = 0; i < count; ++i) {
      if (is_dropped(world, i, camera, drop_camera, drop_share)) continue;
      const std::int64_t ns = stamp_ns(world, i);
      list += fmt::sprintf("%" PRId64 ",%" PRId64 ".png\n", ns, ns);
    }
    const fs::path place = folder / "mav0" / fmt::sprintf("cam%d", camera);
    write_file_atomic(place / "data.csv", list);
    write_file_atomic(place / "sensor.yaml",
                      euroc_sensor_yaml(camera, world.rig.left.width(), world.rig.left.height()));
  }
  std::string truth =
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
      "q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], "
      "b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], "
      "b_a_RS_S_z [m s^-2]\n";
  for (int i = 0; i < count; ++i) {
    const Rigid3& T = world.T_w_b[static_cast<std::size_t>(i)];
    const int a = std::max(0, i - 1);
    const int b = std::min(count - 1, i + 1);
    Eigen::Vector3d v = Eigen::Vector3d::Zero();
    if (b > a) {
      v = (world.T_w_b[static_cast<std::size_t>(b)].t() -
           world.T_w_b[static_cast<std::size_t>(a)].t()) /
          (world.times[static_cast<std::size_t>(b)] - world.times[static_cast<std::size_t>(a)]);
    }
    truth +=
        fmt::sprintf("%" PRId64 ",%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.6f,%.6f,%.6f,0,0,0,0,0,0\n",
                     stamp_ns(world, i), T.t().x(), T.t().y(), T.t().z(), T.rotation.w(),
                     T.rotation.x(), T.rotation.y(), T.rotation.z(), v.x(), v.y(), v.z());
  }
  const fs::path place = folder / "mav0" / "state_groundtruth_estimate0";
  make_output_folder(place);
  write_file_atomic(place / "data.csv", truth);
  write_file_atomic(
      place / "sensor.yaml",
      std::string_view("%YAML:1.0\nsensor_type: visual-inertial\ncomment: the simulated "
                       "path of the body frame\nT_BS:\n  cols: 4\n  rows: 4\n  data: "
                       "[1.0, 0.0, 0.0, 0.0,\n         0.0, 1.0, 0.0, 0.0,\n         "
                       "0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n"));
}

}  // namespace

std::vector<fs::path> image_folders(const World& world) {
  if (world.layout == Layout::kKitti) return {"image_0", "image_1"};
  return {"mav0/cam0/data", "mav0/cam1/data"};
}

fs::path image_path(const World& world, int frame, int camera) {
  const fs::path folder = image_folders(world)[static_cast<std::size_t>(camera)];
  if (world.layout == Layout::kKitti) return folder / fmt::sprintf("%06d.png", frame);
  return folder / fmt::sprintf("%" PRId64 ".png", stamp_ns(world, frame));
}

bool is_dropped(const World& world, int frame, int camera, int drop_camera, double drop_share) {
  if (world.layout != Layout::kEuroc || camera != drop_camera) return false;
  if (frame == 0 || frame + 1 == static_cast<int>(world.times.size())) return false;
  const std::uint64_t h = hash_of(world.seed, 909, static_cast<std::uint64_t>(frame));
  return static_cast<double>(h >> 11) * 0x1.0p-53 < drop_share;
}

void write_layout_files(const World& world, const fs::path& folder, int drop_camera,
                        double drop_share) {
  if (world.layout == Layout::kKitti) {
    write_kitti(world, folder);
  } else {
    write_euroc(world, folder, drop_camera, drop_share);
  }
}

std::string readme_text(const World& world, const std::string& command, bool with_truth) {
  std::string text = "A simulated sequence: world " + world.name + ", seed " +
                     std::to_string(world.seed) + ", " + std::to_string(world.times.size()) +
                     " frames. Made by\n\n    " + command + "\n\n";
  if (world.layout == Layout::kKitti) {
    text +=
        "image_0, image_1     left and right image, rectified; calib.txt, times.txt (s)\n"
        "poses.txt            true pose of the left camera, 3x4 row-major, frame 0 is the origin\n";
  } else {
    text +=
        "mav0                 EuRoC ASL layout: raw (distorted) images, calibration, and the true\n"
        "                     pose of the body frame\n";
    if (with_truth) {
      const StereoCamera& k = world.rectified;
      text += fmt::sprintf(
          "What follows refers to the rectified pair: %dx%d px, f %.6f px, c (%.6f, %.6f) px,\n"
          "baseline %.9f m. Files are named by the left image's time stamp.\n",
          k.width, k.height, k.fx, k.cx, k.cy, k.baseline);
    }
  }
  if (world.rig_error) {
    text +=
        "rig_error.yaml       how the true cameras differ from the calibration: the pair is not\n"
        "                     perfectly rectified. Poses are those of the true left camera\n";
  }
  if (with_truth && world.rig_error) {
    text +=
        "What follows is in the pixels of the images as they are. Disparity is the difference of\n"
        "columns, and not exactly f baseline / depth.\n";
  }
  if (with_truth) {
    text +=
        "disparity            exact, of the left image: 16-bit PNG, value / 256 px, 0 = none "
        "(sky)\n"
        "disparity_right      the same of the right image\n"
        "flow_left/right      exact flow to the next frame: 16-bit RGB PNG, u = (R - 32768) / 64,\n"
        "                     v = (G - 32768) / 64, B = 1 valid. Valid also where the end is\n"
        "                     hidden or outside the image. None for the last frame\n"
        "panoptic_left/right  COCO panoptic PNG, id = R + 256 G + 65536 B, and .json beside the\n"
        "                     folder. Ids differ from frame to frame. 0: unlabelled (posts)\n"
        "objects.csv          exact pose, velocity and box of everything that can move, where "
        "seen\n"
        "ground_truth.csv     true object of each segment (-1: stuff), and whether it moves from\n"
        "                     this frame to the next\n";
  }
  return text;
}

}  // namespace kys_slam::simulator
