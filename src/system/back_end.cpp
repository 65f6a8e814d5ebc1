// SPDX-License-Identifier: BSD-3-Clause
#include "system/back_end.h"

#include <kys_slam/check_options.h>

#include <utility>

#include "loop_closing/strict_distances.h"

namespace kys_slam {

void describe(kys::OptionList& list, BackEndOptions& o) {
  describe(list, o.mapping);
  describe(list, o.loop);
  describe(list, o.full_bundle);
  describe(list, o.relocalization);
}

BackEnd::BackEnd(const StereoCamera& camera, const ScaleLevels& scales,
                 const BackEndOptions& options, const kys::DistanceModel& model, bool threaded)
    : model_(&model),
      relocalization_(checked(options.relocalization)),
      map_(camera, scales),
      mapper_(options.mapping, model),
      places_(strict_places(scales.distances)),
      closer_(options.loop, options.mapping.bundle, model),
      full_bundle_(options.full_bundle, threaded) {
  if (model.uses_belief()) map_.keep_beliefs();
}

ChangeSet BackEnd::continue_map(Map map) {
  map_ = std::move(map);
  if (model_->uses_belief()) map_.keep_beliefs();
  mapper_.continue_map(map_);
  return publish();
}

BackEndStep BackEnd::process(const KeyFrameMessage& message, const std::atomic<bool>* stop) {
  BackEndStep step;
  step.frame_index = message.frame_index;
  full_bundle_.take_over_if_due(map_, message.id);
  step.report = mapper_.process(map_, message, stop);
  step.loop = closer_.process(map_, message.id, places_, stop);
  if (step.loop.closed) {
    full_bundle_.start(map_, map_.keyframe(message.id).submap, message.id);
  }
  step.changes = publish();
  return step;
}

ChangeSet BackEnd::finish(const std::atomic<bool>* stop) {
  full_bundle_.finish(map_);
  mapper_.finish(map_, stop);
  return publish();
}

/// What changed, for the index of places and for the tracker.
ChangeSet BackEnd::publish() {
  ChangeSet changes = map_.take_changes();
  places_.apply(changes);
#ifndef NDEBUG
  map_.check_consistency();
#endif
  return changes;
}

std::optional<VerifiedPlace> BackEnd::relocalize(const FrameFeatures& features,
                                                 kys::Statistics& statistics) const {
  return kys_slam::relocalize(map_, places_, features, relocalization_, *model_, statistics);
}

BackEndRunner::BackEndRunner(const StereoCamera& camera, const ScaleLevels& scales,
                             const BackEndOptions& options, const kys::DistanceModel& model,
                             Schedule schedule, int delay)
    : back_end_(camera, scales, options, model, schedule != Schedule::kSequential),
      schedule_(schedule),
      delay_(delay) {
  if (schedule_ != Schedule::kSequential) thread_ = std::thread([this] { run(); });
}

BackEndRunner::~BackEndRunner() {
  if (!thread_.joinable()) return;
  interrupt();
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
    inbox_.clear();
  }
  changed_.notify_all();
  thread_.join();
}

void BackEndRunner::submit(KeyFrameMessage message) {
  ++waiting_;
  submitted_.push_back(message.frame_index);
  try {
    if (schedule_ == Schedule::kSequential) {
      done_.push_back(back_end_.process(message, &stop_));
      return;
    }
    const std::lock_guard lock(mutex_);
    inbox_.push_back(std::move(message));
  } catch (...) {  // whoever waits for this step learns why there is none
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    throw;
  }
  changed_.notify_all();
}

/// Adds the oldest step, waited for. False when it failed and `steps` has some before it.
bool BackEndRunner::take(std::unique_lock<std::mutex>& lock, std::vector<BackEndStep>& steps) {
  changed_.wait(lock, [&] { return !done_.empty() || failure_; });
  if (done_.empty()) {
    if (steps.empty()) std::rethrow_exception(failure_);
    return false;
  }
  steps.push_back(std::move(done_.front()));
  done_.pop_front();
  submitted_.pop_front();
  --waiting_;
  return true;
}

std::vector<BackEndStep> BackEndRunner::collect(std::int64_t frame_index) {
  std::vector<BackEndStep> steps;
  std::unique_lock lock(mutex_);
  while (!submitted_.empty()) {
    bool due = false;
    switch (schedule_) {
      case Schedule::kSequential:
        due = true;
        break;
      case Schedule::kPipelined:
        due = submitted_.front() + delay_ < frame_index;
        break;
      case Schedule::kRealtime:
        due = !done_.empty() || failure_;
        break;
    }
    if (!due || !take(lock, steps)) break;
  }
  return steps;
}

std::vector<BackEndStep> BackEndRunner::drain() {
  std::vector<BackEndStep> steps;
  std::unique_lock lock(mutex_);
  while (!submitted_.empty() && take(lock, steps)) continue;
  return steps;
}

ChangeSet BackEndRunner::finish() {
  try {
    return back_end_.finish(&stop_);
  } catch (...) {
    const std::lock_guard lock(mutex_);
    failure_ = std::current_exception();
    throw;
  }
}

void BackEndRunner::wait_idle() {
  if (schedule_ == Schedule::kSequential) return;  // every step ends before `submit` does
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return done_.size() == submitted_.size() || failure_; });
}

void BackEndRunner::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return quit_ || !inbox_.empty(); });
    if (quit_) return;
    const KeyFrameMessage message = std::move(inbox_.front());
    inbox_.pop_front();
    lock.unlock();
    try {
      BackEndStep step = back_end_.process(message, &stop_);
      lock.lock();
      done_.push_back(std::move(step));
    } catch (...) {
      if (!lock.owns_lock()) lock.lock();
      failure_ = std::current_exception();
    }
    changed_.notify_all();
    if (failure_) return;
  }
}

}  // namespace kys_slam
