// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/frame_source.h>

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

/// Trajectories as text. Readers throw InputError naming file and line: missing file, wrong number
/// of columns, numbers that are not finite, invalid rotations, time stamps that do not increase.
namespace kys_slam {

/// [R|t] from 12 numbers, row by row (a fourth row may follow and is ignored). Nothing when R is
/// not a rotation to 1e-3 or a number is not finite.
std::optional<Rigid3> rigid_from_row_major(const double* values);

/// KITTI: 12 numbers per line, rows of [R|t], one line per frame.
std::vector<Rigid3> read_kitti_poses(const std::filesystem::path& path);

/// Whether a file may contain two poses with the same time stamp, as some published trajectories
/// do.
enum class Stamps { kIncrease, kMayRepeat };

/// TUM: "timestamp tx ty tz qx qy qz qw" (s, m).
std::vector<TimedPose> read_tum_poses(const std::filesystem::path& path,
                                      Stamps stamps = Stamps::kIncrease);

/// EuRoC ground truth: "timestamp[ns],px,py,pz,qw,qx,qy,qz,...", poses T_w_b of the body. The
/// caller converts them to the camera.
std::vector<TimedPose> read_euroc_poses(const std::filesystem::path& path);

/// The text of a TUM file, nine decimals per number: the same poses give the same bytes. qw >= 0.
std::string format_tum(std::span<const TimedPose> poses);
/// The text of a KITTI file, nine decimals per number.
std::string format_kitti(std::span<const Rigid3> poses);

/// Writes atomically. \throws InputError "cannot write ...".
void write_tum_poses(const std::filesystem::path& path, std::span<const TimedPose> poses);
void write_kitti_poses(const std::filesystem::path& path, std::span<const Rigid3> poses);

}  // namespace kys_slam
