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
  first_own_ = {map_.keyframe_id_end()};
  if (model_->uses_belief()) map_.keep_beliefs();
  mapper_.continue_map(map_);
  return publish();
}

BackEndStep BackEnd::process(const KeyFrameMessage& message, const std::atomic<bool>* stop,
                             bool behind) {
  BackEndStep step;
  step.frame_index = message.frame_index;
  grown_ = true;
  full_bundle_.take_over_if_due(map_, message.id);
  step.report = mapper_.process(map_, message, stop, behind);
  step.loop = closer_.process(map_, message.id, places_, stop);
  if (step.loop.closed) {
    full_bundle_.start(map_, map_.keyframe(message.id).submap, message.id);
  }
  step.changes = publish();
  return step;
}

BackEndEnd BackEnd::finish(const std::atomic<bool>* stop) {
  full_bundle_.finish(map_);
  BackEndEnd end;
  if (grown_) end.joined = join_submaps(stop);
  mapper_.finish(map_, stop);
  end.last = publish();
  return end;
}

/// The other sub-maps are searched again for all keyframes, now that those around them are known.
/// The keyframes of the largest sub-map are compared with those of the others.
std::vector<BackEndStep> BackEnd::join_submaps(const std::atomic<bool>* stop) {
  std::vector<BackEndStep> joined;
  const KeyFrameId largest = map_.largest_submap();
  for (const KeyFrameId id : map_.keyframes().ids()) {
    if (stop != nullptr && *stop) break;
    if (!map_.has(id) || map_.submap(id) == map_.submap(largest)) continue;
    BackEndStep step;
    step.frame_index = id < first_own_ ? -1 : map_.keyframe(id).frame_index;
    step.loop = closer_.join(map_, id, places_, stop);
    if (!step.loop.closed) continue;
    full_bundle_.start(map_, map_.keyframe(id).submap, id);
    full_bundle_.finish(map_);
    step.changes = publish();
    joined.push_back(std::move(step));
  }
  return joined;
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

std::optional<VerifiedPlace> BackEnd::relocalize(const FrameFeatures& features, KeyFrameId except,
                                                 kys::Statistics& statistics) const {
  return kys_slam::relocalize(map_, places_, features, except, relocalization_, *model_,
                              statistics);
}

BackEndStep BackEnd::join_at(const FrameFeatures& features, const VerifiedPlace& there,
                             KeyFrameId submap) {
  BackEndStep step;
  const std::vector<KeyFrameId> members = map_.submap_keyframes(submap);
  if (members.empty() || submap == map_.submap(there.keyframe)) return step;
  step.frame_index = map_.keyframe(members.back()).frame_index;
  step.loop = closer_.join_at(map_, features, there, members.back());
  step.changes = publish();
  return step;
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
      done_.push_back(back_end_.process(message, &stop_, false));
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

BackEndEnd BackEndRunner::finish() {
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
    const bool behind = schedule_ == Schedule::kRealtime && !inbox_.empty();
    lock.unlock();
    try {
      BackEndStep step = back_end_.process(message, &stop_, behind);
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
