#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/system.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "loop_closing/full_bundle.h"
#include "loop_closing/loop_closer.h"
#include "loop_closing/relocalization.h"
#include "map/keyframe_message.h"
#include "map/map.h"
#include "mapping/local_mapper.h"
#include "retrieval/place_index.h"

namespace kys_slam {

/// What the back end answers to one keyframe.
struct BackEndStep {
  std::int64_t frame_index = 0;  ///< of the keyframe
  ChangeSet changes;
  LocalMapperReport report;
  LoopReport loop;
};

struct BackEndOptions {
  LocalMapperOptions mapping;
  LoopOptions loop;
  FullBundleOptions full_bundle;
  RelocalizationOptions relocalization;
};
/// For check_options().
void describe(kys::OptionList& list, BackEndOptions& options);

/// Owner and only writer of the map: one step per keyframe message, local mapping and loop closing.
/// Knows nothing of the thread it runs in; full bundle adjustment has one of its own when
/// `threaded`.
class BackEnd {
 public:
  /// \param model has to outlive the back end
  BackEnd(const StereoCamera& camera, const ScaleLevels& scales, const BackEndOptions& options,
          const kys::DistanceModel& model, bool threaded);

  /// Before the first keyframe: goes on with a map made earlier. Returns all of it.
  ChangeSet continue_map(Map map);
  BackEndStep process(const KeyFrameMessage& message, const std::atomic<bool>* stop);
  /// Takes over what full bundle adjustment still has under way.
  ChangeSet finish();
  /// Where a frame is in the map, if it is at a known place.
  [[nodiscard]] std::optional<VerifiedPlace> relocalize(const FrameFeatures& features,
                                                        kys::Statistics& statistics) const;
  /// Full bundle adjustment stops. From any thread.
  void interrupt() { full_bundle_.interrupt(); }
  [[nodiscard]] const Map& map() const { return map_; }

 private:
  ChangeSet publish();

  const kys::DistanceModel* model_;
  RelocalizationOptions relocalization_;
  Map map_;
  LocalMapper mapper_;
  PlaceIndex places_;
  LoopCloser closer_;
  FullBundle full_bundle_;
};

/// Runs the back end by a schedule: messages go in, finished steps come out at frame boundaries.
///   sequential: a step runs inside `submit` and comes out at the next boundary;
///   pipelined: it runs in a thread and comes out `delay` frames later, waited for if need be;
///   realtime: it runs in a thread and comes out when it is ready.
class BackEndRunner {
 public:
  /// \param model has to outlive the runner
  BackEndRunner(const StereoCamera& camera, const ScaleLevels& scales,
                const BackEndOptions& options, const kys::DistanceModel& model, Schedule schedule,
                int delay);
  BackEndRunner(const BackEndRunner&) = delete;
  BackEndRunner& operator=(const BackEndRunner&) = delete;
  ~BackEndRunner();

  /// Before the first message.
  ChangeSet continue_map(Map map) { return back_end_.continue_map(std::move(map)); }
  void submit(KeyFrameMessage message);
  /// Steps that are due before frame `frame_index` is tracked, in order.
  std::vector<BackEndStep> collect(std::int64_t frame_index);
  /// All that is left; waits for it.
  std::vector<BackEndStep> drain();
  /// Messages submitted and not yet collected.
  [[nodiscard]] int waiting() const { return waiting_; }
  /// Waits until every message submitted is processed; what came of them stays to be collected.
  /// The map then stays as it is until the next `submit`.
  void wait_idle();
  /// After `drain`: the map's last correction.
  ChangeSet finish() { return back_end_.finish(); }
  /// After `drain`.
  [[nodiscard]] std::optional<VerifiedPlace> relocalize(const FrameFeatures& features,
                                                        kys::Statistics& statistics) const {
    return back_end_.relocalize(features, statistics);
  }
  /// Optimisation under way stops early, and all that follows.
  void interrupt() {
    stop_ = true;
    back_end_.interrupt();
  }
  /// After `drain` or `wait_idle`. When a step has failed, the map is as that step left it, half
  /// changed.
  [[nodiscard]] const Map& map() const { return back_end_.map(); }
  /// After `drain`.
  [[nodiscard]] bool failed() const { return failure_ != nullptr; }

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
