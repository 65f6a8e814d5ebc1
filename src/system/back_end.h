#pragma once

#include <kys/distance_model.h>
#include <kys_slam/system.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "map/keyframe_message.h"
#include "map/map.h"
#include "mapping/local_mapper.h"

namespace kys_slam {

/// What the back end answers to one keyframe.
struct BackEndStep {
  std::int64_t frame_index = 0;  ///< of the keyframe
  ChangeSet changes;
  LocalMapperReport report;
};

/// Owner and only writer of the map: one step per keyframe message. Knows nothing of threads.
class BackEnd {
 public:
  BackEnd(const StereoCamera& camera, const ScaleLevels& scales, const LocalMapperOptions& options,
          const kys::DistanceModel& model);

  BackEndStep process(const KeyFrameMessage& message, const std::atomic<bool>* stop);
  [[nodiscard]] const Map& map() const { return map_; }

 private:
  Map map_;
  LocalMapper mapper_;
};

/// Runs the back end by a schedule: messages go in, finished steps come out at frame boundaries.
///   sequential: a step runs inside `submit` and comes out at the next boundary;
///   pipelined: it runs in a thread and comes out `delay` frames later, waited for if need be;
///   realtime: it runs in a thread and comes out when it is ready.
class BackEndRunner {
 public:
  BackEndRunner(BackEnd back_end, Schedule schedule, int delay);
  BackEndRunner(const BackEndRunner&) = delete;
  BackEndRunner& operator=(const BackEndRunner&) = delete;
  ~BackEndRunner();

  void submit(KeyFrameMessage message);
  /// Steps that are due before frame `frame_index` is tracked, in order.
  std::vector<BackEndStep> collect(std::int64_t frame_index);
  /// All that is left; waits for it.
  std::vector<BackEndStep> drain();
  /// Messages submitted and not yet collected.
  [[nodiscard]] int waiting() const { return waiting_; }
  /// Optimisation under way stops early, and all that follows.
  void interrupt() { stop_ = true; }
  /// After `drain`.
  [[nodiscard]] const Map& map() const { return back_end_.map(); }

 private:
  void run();
  BackEndStep take(std::unique_lock<std::mutex>& lock);

  BackEnd back_end_;
  Schedule schedule_;
  int delay_;
  int waiting_ = 0;                     // caller's thread
  std::deque<std::int64_t> submitted_;  // frame of every message not collected; caller's thread
  std::atomic<bool> stop_{false};

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<KeyFrameMessage> inbox_;
  std::deque<BackEndStep> done_;
  std::exception_ptr failure_;
  bool quit_ = false;
  std::thread thread_;
};

}  // namespace kys_slam
