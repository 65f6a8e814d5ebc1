// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "object_evaluation.h"

namespace kys_slam {

/// The objects and poses in the folder of a run.
struct ObjectRun {
  std::vector<EstimatedObject> objects;  ///< objects.csv
  std::map<int, FramePoses> frames;      ///< by index in the sequence
  bool has_ground_truth = false;         ///< of the camera; if false, its estimate is used
};

/// Reads objects.csv, frames.csv, trajectory.kitti and, when it is there, ground_truth.tum.
/// \throws InputError naming the file and what is wrong with it.
ObjectRun read_object_run(const std::filesystem::path& folder);

/// True objects, in the order of the file. The first line identifies the format:
/// - objects.csv of simulate_sequence, in the frame of the ground truth;
/// - pose.txt of Virtual KITTI 2 (left camera; with bbox.txt in the same folder, if it exists);
/// - label files of KITTI Tracking; they are in the frame of camera 0 and are moved to that of
///   camera 2 when calib/NAME.txt lies beside their folder. The latter two are expressed in the
///   camera frame; `frames` has the camera poses. Their position is that of the centre of the
///   bottom of the box. Without bbox.txt, objects faster than 0.5 m/s count as moving.
/// \throws InputError naming the file and what is wrong with it.
std::vector<TrueObject> read_true_objects(const std::filesystem::path& file,
                                          const std::map<int, FramePoses>& frames);

}  // namespace kys_slam
