// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>

#include <exception>
#include <map>
#include <stdexcept>

#include "system/run_summary.h"
#include "system/run_tables.h"

namespace kys_slam {

namespace {

/// One row per frame; a frame without a pose repeats the one before (frames.csv tells which).
std::vector<Rigid3> all_poses(const std::vector<FrameEstimate>& trajectory) {
  std::vector<Rigid3> poses;
  for (const FrameEstimate& estimate : trajectory) {
    if (estimate.connected) {
      poses.push_back(estimate.T_w_c);
    } else {
      poses.push_back(poses.empty() ? Rigid3() : poses.back());
    }
  }
  return poses;
}

/// Writes files one by one: one that cannot be written does not keep the others from it.
class Files {
 public:
  template <typename Write>
  void write(Write&& write) {
    try {
      write();
    } catch (...) {
      ++failed_;
      if (!first_) first_ = std::current_exception();
    }
  }

  /// \throws what the first file that failed threw
  void check() const {
    if (!first_) return;
    if (failed_ == 1) std::rethrow_exception(first_);
    const Failure failure = describe_failure(first_);
    const std::string text = fmt::format("{} (and {} more files)", failure.message, failed_ - 1);
    if (failure.status != kBadInput) throw std::runtime_error(text);
    throw InputError(text);
  }

 private:
  int failed_ = 0;
  std::exception_ptr first_;
};

/// submap_N.tum: the frames of every sub-map that is not connected to the one of trajectory.tum,
/// each in a frame of its own. N is that of frames.csv. Files of a run before are removed.
void write_other_submaps(const std::filesystem::path& folder,
                         const std::vector<FrameEstimate>& trajectory, Files& files) {
  for (const std::filesystem::path& file : list_folder(folder)) {
    const std::string name = file.filename().string();
    std::error_code ignored;
    if (name.starts_with("submap_") && name.ends_with(".tum")) {
      std::filesystem::remove(file, ignored);
    }
  }
  std::map<std::int64_t, std::vector<TimedPose>> others;
  for (const FrameEstimate& e : trajectory) {
    if (e.submap >= 0 && !e.connected) others[e.submap].push_back({e.timestamp, e.T_w_c});
  }
  for (const auto& [submap, poses] : others) {
    files.write([&, n = submap, &p = poses] {
      write_tum_poses(folder / fmt::format("submap_{}.tum", n), p);
    });
  }
}

}  // namespace

void write_run(const std::filesystem::path& folder, const System& system, const Settings& settings,
               Schedule schedule, const RunInfo& info, const RunOutcome& outcome) {
  make_output_folder(folder);
  // The summary comes last: without it a folder is not a complete run.
  std::error_code ignored;
  std::filesystem::remove(behind_links(folder / "summary.json"), ignored);
  if (info.ground_truth.empty()) {
    std::filesystem::remove(behind_links(folder / "ground_truth.tum"), ignored);
  }
  Files files;
  files.write([&] { write_tum_poses(folder / "trajectory.tum", outcome.connected); });
  files.write(
      [&] { write_kitti_poses(folder / "trajectory.kitti", all_poses(outcome.trajectory)); });
  files.write([&] { write_tum_poses(folder / "keyframes.tum", system.keyframes()); });
  write_other_submaps(folder, outcome.trajectory, files);
  if (!info.ground_truth.empty()) {
    files.write([&] { write_tum_poses(folder / "ground_truth.tum", info.ground_truth); });
  }
  files.write(
      [&] { write_file_atomic(folder / "frames.csv", frames_csv(system, outcome.trajectory)); });
  files.write([&] { write_file_atomic(folder / "covariance.csv", covariance_csv(system)); });
  files.write([&] {
    write_file_atomic(folder / "objects.csv",
                      objects_csv(system, settings.get("control.label_space")));
  });
  MapSnapshot map;
  files.write([&] { map = system.snapshot(); });
  files.write([&] { write_file_atomic(folder / "graph.csv", graph_csv(map)); });
  files.write([&] {
    write_file_atomic(folder / "map.ply", map_ply(map, settings.get("control.label_space")));
  });
  files.write([&] { write_file_atomic(folder / "config.yaml", settings.to_yaml()); });
  files.write([&] {
    write_file_atomic(folder / "summary.json", summary_json(system, schedule, info, outcome));
  });
  files.check();
}

void save_map_or_beside(const System& system, const std::filesystem::path& file,
                        const std::filesystem::path& folder) {
  try {
    system.save_map(file);
  } catch (const InputError& error) {
    const std::filesystem::path instead = folder / "saved.map";
    try {
      system.save_map(instead);
    } catch (const InputError&) {
      throw error;
    }
    throw InputError(std::string(error.what()) + "; the map is in " + instead.string());
  }
}

}  // namespace kys_slam
