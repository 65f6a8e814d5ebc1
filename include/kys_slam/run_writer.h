// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/evaluation.h>
#include <kys_slam/settings.h>
#include <kys_slam/system.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace kys_slam {

/// Facts about a run that are written in addition to the trajectory.
struct RunInfo {
  std::string sequence;
  std::string mode;
  std::string recording;                ///< that of FrameInput; "": not known
  std::vector<TimedPose> ground_truth;  ///< left camera; empty: none
  double start_up_s = 0;                ///< s, from the start of the program to the first frame
  double wall_s = 0;                    ///< s, from the first frame to the end of the back end
  double cpu_s = 0;                     ///< s, processor time within wall_s
  bool complete = true;                 ///< false: interrupted, or stopped by bad input
  std::string end_reason;               ///< reason, when `complete` is false
  std::int64_t missing_priors = 0;      ///< frames without a prior file
  std::vector<std::string> warnings;    ///< what the user was shown, e.g. by PairWatch
  /// Input that was not used: counts by description ("frames that came too fast").
  std::map<std::string, std::int64_t> left_out;
};

/// Results of a run, computed once.
struct RunOutcome {
  std::vector<FrameEstimate> trajectory;
  std::vector<TimedPose> connected;    ///< frames with a pose in the frame of the trajectory
  std::optional<Evaluation> accuracy;  ///< empty when fewer than three poses have ground truth
  std::int64_t tracked = 0;            ///< frames
  std::int64_t keyframes_made = 0;
  std::int64_t loops = 0;
  std::int64_t merges = 0;
  std::int64_t relocalised = 0;
};
RunOutcome summarise_run(const System& system, const RunInfo& info);

/// Writes a run's folder, every file atomically: trajectory.tum, trajectory.kitti, keyframes.tum,
/// submap_N.tum (frames of sub-maps that are not connected to that of trajectory.tum),
/// ground_truth.tum (when there is any), frames.csv, covariance.csv, objects.csv, summary.json,
/// config.yaml, map.ply, graph.csv. All but summary.json's `timing_ms`, `process`, `peak_memory_mb`
/// and frames.csv's columns `ms_*` and `resident_mb` depend on input and settings alone.
///
/// \throws InputError when a file cannot be written, after all others have been.
void write_run(const std::filesystem::path& folder, const System& system, const Settings& settings,
               Schedule schedule, const RunInfo& info, const RunOutcome& outcome);

/// Saves the map to `file`, or to saved.map in `folder` when `file` cannot be written.
/// \throws InputError when `file` could not be written; the message says where the map is instead.
void save_map_or_beside(const System& system, const std::filesystem::path& file,
                        const std::filesystem::path& folder);

/// "tracking failed: ..." when less than half of the frames are connected
/// (FrameEstimate::connected), else "".
std::string describe_failure_to_track(const System& system, const RunOutcome& outcome);

/// The table printed at the end of a run: frames, accuracy, time per stage, memory.
std::string describe_run(const System& system, const RunInfo& info, const RunOutcome& outcome);

}  // namespace kys_slam
