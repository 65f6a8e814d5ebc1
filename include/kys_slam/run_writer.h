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

/// What a run's folder says beside the trajectory.
struct RunInfo {
  std::string sequence;
  std::string mode;
  std::vector<TimedPose> ground_truth;  ///< left camera; empty: none
  double start_up_s = 0;                ///< from the program's start to the first frame
  double wall_s = 0;                    ///< from the first frame to the end of the back end
  double cpu_s = 0;                     ///< processor time in between
  bool complete = true;                 ///< false: interrupted, or stopped by bad input
  std::string end_reason;               ///< why, when it is not complete
  std::int64_t missing_priors = 0;      ///< frames without a prior file
  std::vector<std::string> warnings;    ///< what the user was shown, e.g. by PairWatch
  /// What the input holds and was not used, counts by what it is ("frames that came too fast").
  std::map<std::string, std::int64_t> left_out;
};

/// What came of a run, worked out once.
struct RunOutcome {
  std::vector<FrameEstimate> trajectory;
  std::vector<TimedPose> connected;  ///< frames with a pose in the common frame
  std::optional<Evaluation>
      accuracy;              ///< nothing when too little of the ground truth belongs to them
  std::int64_t tracked = 0;  ///< frames
  std::int64_t keyframes_made = 0;
  std::int64_t loops = 0;
  std::int64_t merges = 0;
  std::int64_t relocalised = 0;
};
RunOutcome judge_run(const System& system, const RunInfo& info);

/// Writes a run's folder, every file atomically: trajectory.tum, trajectory.kitti, keyframes.tum,
/// ground_truth.tum (when there is any), frames.csv, summary.json, config.yaml, map.ply. All but
/// summary.json's `timing_ms`, `process`, `peak_memory_mb` and frames.csv's columns `ms_*` and
/// `resident_mb` depend on input and settings alone.
/// \throws InputError when a file cannot be written, after all others have been.
void write_run(const std::filesystem::path& folder, const System& system, const Settings& settings,
               Schedule schedule, const RunInfo& info, const RunOutcome& outcome);

/// The table a run ends with: frames, accuracy, time per stage, memory.
std::string describe_run(const System& system, const RunInfo& info, const RunOutcome& outcome);

}  // namespace kys_slam
