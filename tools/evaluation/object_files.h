#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "object_evaluation.h"

namespace kys_slam {

/// A run's folder, as far as objects are concerned.
struct ObjectRun {
  std::vector<EstimatedObject> objects;  ///< objects.csv
  std::map<int, FramePoses> frames;      ///< by index in the sequence
  bool has_ground_truth = false;         ///< of the camera; without, its estimate stands in
};

/// Reads objects.csv, frames.csv, trajectory.kitti and, when it is there, ground_truth.tum.
/// \throws InputError naming the file and what is wrong with it.
ObjectRun read_object_run(const std::filesystem::path& folder);

/// True objects, in the order of the file. What it is follows from its first line:
/// - objects.csv of simulate_sequence, in the frame of the ground truth;
/// - pose.txt of Virtual KITTI 2 (left camera; with bbox.txt beside it, if that is there);
/// - label files of KITTI Tracking.
/// The latter two are expressed in the camera's frame; `frames` says where the camera is. There the
/// position is taken for the middle of the box's bottom, and what moves is worked out from the
/// poses (more than 0.5 m/s), unless bbox.txt says so.
/// \throws InputError naming the file and what is wrong with it.
std::vector<TrueObject> read_true_objects(const std::filesystem::path& file,
                                          const std::map<int, FramePoses>& frames);

}  // namespace kys_slam
