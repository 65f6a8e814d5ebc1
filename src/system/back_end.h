// SPDX-License-Identifier: BSD-3-Clause
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

/// Result of the back end for one keyframe.
struct BackEndStep {
  std::int64_t frame_index = 0;  ///< of the keyframe
  ChangeSet changes;
  LocalMapperReport report;
  LoopReport loop;
};

/// What the back end does after the last keyframe.
struct BackEndEnd {
  /// Sub-maps joined. `frame_index` is that of the keyframe that sees the place of the other one;
  /// -1: it is of a loaded map.
  std::vector<BackEndStep> joined;
  ChangeSet last;
};

struct BackEndOptions {
  LocalMapperOptions mapping;
  LoopOptions loop;
  FullBundleOptions full_bundle;
  RelocalizationOptions relocalization;
};
/// For check_options().
void describe(kys::OptionList& list, BackEndOptions& options);

/// Owner and only writer of the map: one step per keyframe message, with local mapping and loop
/// closing. Runs in the thread of the caller; full bundle adjustment has its own thread when
/// `threaded`.
class BackEnd {
 public:
  /// \param model must outlive the back end
  BackEnd(const StereoCamera& camera, const ScaleLevels& scales, const BackEndOptions& options,
          const kys::DistanceModel& model, bool threaded);

  /// Continues a loaded map; call it before the first keyframe. Returns a change set with the whole
  /// map.
  ChangeSet continue_map(Map map);
  /// Begins with a correction and what it is worth; call it before the first keyframe.
  void start_rig(const RigEstimate& rig) { mapper_.start_rig(rig); }
  /// \param behind other messages wait, at the camera's pace
  BackEndStep process(const KeyFrameMessage& message, const std::atomic<bool>* stop, bool behind);
  /// Priors of keyframes that became known after the last message.
  void set_priors(const std::vector<KeyFramePriors>& late) {
    for (const KeyFramePriors& priors : late) map_.set_priors(priors.keyframe, priors.priors);
  }
  /// Waits for full bundle adjustment, applies its result, joins the sub-maps that show the same
  /// place, and corrects the disparities a last time.
  BackEndEnd finish(const std::atomic<bool>* stop);
  /// Relocalises a frame; nothing when it is not at a known place.
  /// \param except sub-map that is not searched; invalid: none
  [[nodiscard]] std::optional<VerifiedPlace> relocalize(const FrameFeatures& features,
                                                        KeyFrameId except,
                                                        kys::Statistics& statistics) const;
  /// Joins a sub-map with the one in which a frame has been found. No loop: the frame is not found
  /// in this one as well.
  BackEndStep join_at(const FrameFeatures& features, const VerifiedPlace& there, KeyFrameId submap);
  /// Stops full bundle adjustment. Thread-safe.
  void interrupt() { full_bundle_.interrupt(); }
  [[nodiscard]] const Map& map() const { return map_; }
  [[nodiscard]] const std::optional<OffsetEstimate>& offset() const { return mapper_.offset(); }

 private:
  ChangeSet publish();
  std::vector<BackEndStep> join_submaps(const std::atomic<bool>* stop);

  const kys::DistanceModel* model_;
  RelocalizationOptions relocalization_;
  Map map_;
  LocalMapper mapper_;
  PlaceIndex places_;
  LoopCloser closer_;
  FullBundle full_bundle_;
  KeyFrameId first_own_{0};  // older ones come from a loaded map
  bool grown_ = false;       // by keyframes of this run
};

/// Runs the back end by a schedule: takes messages, returns finished steps between two frames.
/// sequential: a step runs inside `submit` and is returned before the next frame; pipelined: it
/// runs in a thread and is returned `delay` frames later, after waiting if necessary; realtime: it
/// runs in a thread and is returned when it is ready.
class BackEndRunner {
 public:
  /// \param model must outlive the runner
  BackEndRunner(const StereoCamera& camera, const ScaleLevels& scales,
                const BackEndOptions& options, const kys::DistanceModel& model, Schedule schedule,
                int delay);
  BackEndRunner(const BackEndRunner&) = delete;
  BackEndRunner& operator=(const BackEndRunner&) = delete;
  ~BackEndRunner();

  /// Before the first message.
  ChangeSet continue_map(Map map) { return back_end_.continue_map(std::move(map)); }
  void start_rig(const RigEstimate& rig) { back_end_.start_rig(rig); }
  void submit(KeyFrameMessage message);
  /// Steps that are due before frame `frame_index` is tracked, in order. Where a step failed, those
  /// before it; the next call throws what it threw.
  std::vector<BackEndStep> collect(std::int64_t frame_index);
  /// All remaining steps; waits for them. Empty only when none remain; failures as in `collect`.
  std::vector<BackEndStep> drain();
  /// Number of messages submitted and not yet collected.
  [[nodiscard]] int waiting() const { return waiting_; }
  /// Waits until every submitted message is processed. Their steps remain to be collected. The map
  /// does not change until the next `submit`.
  void wait_idle();
  /// Call it after `drain`: priors of keyframes that became known after the last message.
  void set_priors(const std::vector<KeyFramePriors>& late) { back_end_.set_priors(late); }
  /// Call it after `drain`: the last corrections of the map.
  BackEndEnd finish();
  /// After `drain`.
  [[nodiscard]] std::optional<VerifiedPlace> relocalize(const FrameFeatures& features,
                                                        KeyFrameId except,
                                                        kys::Statistics& statistics) const {
    return back_end_.relocalize(features, except, statistics);
  }
  /// After `drain`.
  BackEndStep join_at(const FrameFeatures& features, const VerifiedPlace& there,
                      KeyFrameId submap) {
    return back_end_.join_at(features, there, submap);
  }
  /// Stops running and all later optimisation early. Thread-safe.
  void interrupt() {
    stop_ = true;
    back_end_.interrupt();
  }
  /// Call it after `drain` or `wait_idle`. After a failed step the map is in an intermediate state.
  [[nodiscard]] const Map& map() const { return back_end_.map(); }
  /// As `map`.
  [[nodiscard]] const std::optional<OffsetEstimate>& offset() const { return back_end_.offset(); }
  /// After `drain`.
  [[nodiscard]] bool failed() const { return failure_ != nullptr; }

 private:
  void run();
  bool take(std::unique_lock<std::mutex>& lock, std::vector<BackEndStep>& steps);

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
