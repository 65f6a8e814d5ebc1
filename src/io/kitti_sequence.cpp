// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/paths.h>

#include "io/sequence_parts.h"

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

/// Official poses are of camera 0; camera 2 stands 6 cm beside it.
std::vector<TimedPose> read_ground_truth(const fs::path& file, const NamedPairs& pairs,
                                         double x_shift) {
  const std::vector<Rigid3> poses = read_kitti_poses(file);
  const Rigid3 T_c0_c(Eigen::Quaterniond::Identity(), Eigen::Vector3d(-x_shift, 0, 0));
  std::vector<TimedPose> ground_truth;
  for (std::size_t i = 0; i < pairs.frames.size(); ++i) {
    const Rigid3& pose = poses[pairs.row_of(i, poses.size(), file, "poses")];
    ground_truth.push_back({pairs.frames[i].timestamp, T_c0_c.inverse() * pose * T_c0_c});
  }
  return ground_truth;
}

}  // namespace

std::unique_ptr<Sequence> open_kitti_odometry(const fs::path& folder,
                                              const SequenceOptions& options) {
  const bool gray = options.pair == CameraPair::kGrey ||
                    (options.pair == CameraPair::kFirst && is_folder(folder / "image_0"));
  const std::string left = gray ? "0" : "2";
  const std::string right = gray ? "1" : "3";
  Sequence::Content content;
  content.name = folder.filename().string();
  content.layout = "KITTI odometry";
  const fs::path calibration = folder / "calib.txt";
  if (!path_exists(calibration)) throw InputError(calibration.string() + ": no such file");
  NamedPairs pairs = pair_by_name(folder / ("image_" + left), folder / ("image_" + right));
  content.camera = kitti_camera(calibration, "P" + left, "P" + right, pairs.frames.front().left);
  read_times(folder / "times.txt", pairs);

  fs::path poses = folder / "poses.txt";
  if (!path_exists(poses)) {
    poses = folder.parent_path().parent_path() / "poses" / (content.name + ".txt");
  }
  if (path_exists(poses)) {
    const auto P = kitti_projection(calibration, "P" + left);
    content.ground_truth = read_ground_truth(poses, pairs, P(0, 3) / P(0, 0));
  }
  content.dropped = pairs.dropped;
  content.frames = std::move(pairs.frames);
  return make_sequence(std::move(content), options, folder);
}

std::unique_ptr<Sequence> open_kitti_sequence(const fs::path& given,
                                              const SequenceOptions& options) {
  const fs::path folder = sequence_folder(given);
  if (is_folder(folder / "image_0") || is_folder(folder / "image_2")) {
    return open_kitti_odometry(folder, options);
  }
  if (is_folder(folder / "frames" / "rgb" / "Camera_0")) {
    return open_virtual_kitti(folder, options);
  }
  if (folder.parent_path().filename() == "image_02") return open_kitti_tracking(folder, options);
  if (is_euroc_folder(folder)) {
    throw InputError(folder.string() +
                     ": not a KITTI sequence; it is EuRoC's: run_stereo_euroc reads it");
  }
  throw InputError(folder.string() +
                   ": not a KITTI sequence (neither image_0/ nor image_2/ nor "
                   "frames/rgb/Camera_0/ in it, and not below image_02/)");
}

}  // namespace kys_slam
