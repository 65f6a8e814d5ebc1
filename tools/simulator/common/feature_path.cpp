// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/common/feature_path.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/median.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <utility>

#include "simulator/common/euroc_rig.h"

namespace kys_slam::simulator {
namespace {

constexpr double kFarthestPose = 1e6;  // m from the origin

// Numbers on the first line that is not a comment.
int count_columns(const std::filesystem::path& trajectory) {
  std::istringstream file(read_text(trajectory));
  std::string line;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::string word;
    int count = 0;
    while (words >> word) ++count;
    return count;
  }
  throw InputError(trajectory.string() + ": holds no poses");
}

// Whole number of poses from one frame to the next, at most all of them.
std::int64_t step_for_rate(const std::vector<TimedPose>& poses, double frame_rate) {
  std::vector<double> gaps;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    gaps.push_back(poses[i].timestamp - poses[i - 1].timestamp);
  }
  if (gaps.empty()) return 1;
  const double step = 1 / (frame_rate * median(gaps));
  return std::llround(std::clamp(step, 1.0, static_cast<double>(poses.size())));
}

// The camera with images of another width.
StereoCamera scaled(const StereoCamera& k, int width) {
  const double f = static_cast<double>(width) / k.width;
  return {width,     static_cast<int>(std::lround(f * k.height)),
          f * k.fx,  f * k.fy,
          f * k.cx,  f * k.cy,
          k.baseline};
}

}  // namespace

FeaturePath read_feature_path(const std::filesystem::path& trajectory,
                              const FeatureOptions& options) {
  check_options(options);
  FeaturePath path;
  const int columns = count_columns(trajectory);
  if (columns == 12) {
    const std::vector<Rigid3> poses = read_kitti_poses(trajectory);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      path.poses.push_back({static_cast<double>(i) / options.rate, poses[i]});
    }
  } else if (columns == 8) {
    path.poses = read_tum_poses(trajectory);
  } else {
    throw InputError(trajectory.string() + ": " + std::to_string(columns) +
                     " columns; KITTI has 12, TUM has 8");
  }
  const auto count = static_cast<std::int64_t>(path.poses.size());
  if (options.start >= count) {
    throw InputError(trajectory.string() + ": has " + std::to_string(count) + " poses, none at " +
                     std::to_string(options.start));
  }
  const std::int64_t step = options.every * step_for_rate(path.poses, options.frame_rate);
  std::vector<TimedPose> used;
  for (std::int64_t i = options.start; i < count; i += step) {
    if (static_cast<std::int64_t>(used.size()) == options.frames) break;
    used.push_back(path.poses[static_cast<std::size_t>(i)]);
  }
  path.poses = std::move(used);
  for (const TimedPose& pose : path.poses) {
    if (pose.T_w_c.t().cwiseAbs().maxCoeff() < kFarthestPose) continue;
    throw InputError(trajectory.string() + ": a pose lies more than 1000 km from the origin");
  }
  const bool kitti = options.camera == "kitti" || (options.camera == "auto" && columns == 12);
  if (kitti) {
    path.camera = {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 386.1448 / 718.856};
    if (options.width > 0) path.camera = scaled(path.camera, options.width);
    path.ground = 1.65;
    path.features = 2000;
  } else {
    const StereoRectifier rectifier = euroc_rectifier();
    path.camera = rectifier.camera();
    path.near = 0.8;
    path.far = 12;
    if (columns == 8) {
      for (TimedPose& pose : path.poses) pose.T_w_c = pose.T_w_c * rectifier.T_b_c();
    }
  }
  if (options.features > 0) path.features = options.features;
  if (options.near > 0) path.near = options.near;
  if (options.far > 0) path.far = options.far;
  if (path.near >= path.far) throw InputError("--near: must be less than --far");
  return path;
}

}  // namespace kys_slam::simulator
