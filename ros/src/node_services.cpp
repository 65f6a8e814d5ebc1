// SPDX-License-Identifier: BSD-3-Clause
// Services, diagnostics, the end.
#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/run_writer.h>

#include "node_run.h"

namespace kys_slam::ros {

NodeLogic::Answer NodeLogic::save_map(const std::string& file) {
  const std::lock_guard run_lock(run_mutex_);
  if (file.empty()) return {false, "no file given"};
  if (!run_ || run_->fed == 0) return {false, "there is no map yet"};
  try {
    run_->system.save_map(file);
  } catch (const InputError& error) {
    return {false, error.what()};
  }
  return {true, "saved " + file};
}

NodeLogic::Answer NodeLogic::load_map(const std::string& file, bool localize_only) {
  const std::lock_guard run_lock(run_mutex_);
  if (file.empty()) return {false, "no file given"};
  if (!run_) {
    return {false,
            "there is no image with a camera_info yet; the parameter load_map loads a map at the "
            "start"};
  }
  try {
    auto run = make_run(run_->images);
    run->system.load_map(file, localize_only);
    begin(std::move(run), "the run starts again in " + file);
  } catch (const InputError& error) {
    return {false, error.what()};
  } catch (const kys::Error& error) {
    return {false, error.what()};
  }
  return {true, "loaded " + file};
}

NodeLogic::Answer NodeLogic::reset() {
  const std::lock_guard run_lock(run_mutex_);
  {
    const std::lock_guard lock(mutex_);
    infos_.take_latest();
    queue_.clear();
    early_.clear();
    jump_.reset();
  }
  begin(nullptr, "reset: the run starts again");
  return {true, "the next pair starts a map"};
}

Diagnostics NodeLogic::diagnostics() {
  const std::lock_guard lock(mutex_);
  log_.missing_info = infos_.missing();
  return log_.take(queue_.counts());
}

std::vector<PoseOutput> NodeLogic::path() const {
  const std::lock_guard lock(mutex_);
  return {path_.begin(), path_.end()};
}

void NodeLogic::finish() {
  const std::lock_guard run_lock(run_mutex_);
  if (!run_ || run_->fed == 0) return;
  run_->system.finish();
  if (options_.output.empty()) return;
  RunInfo info;
  info.sequence = "ros";
  info.mode = settings_.get("kys.mode");
  {
    const std::lock_guard lock(mutex_);
    const PairCounts& counts = queue_.counts();
    info.left_out = {{"pairs that came while others were tracked", counts.dropped},
                     {"images without a partner", counts.unmatched},
                     {"images out of order", counts.out_of_order}};
  }
  std::erase_if(info.left_out, [](const auto& entry) { return entry.second == 0; });
  write_run(options_.output, run_->system, settings_, options_.schedule, info,
            summarise_run(run_->system, info));
}

}  // namespace kys_slam::ros
