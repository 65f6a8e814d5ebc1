// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <atomic>
#include <memory>
#include <vector>

#include "map/map.h"
#include "mapping/local_bundle.h"
#include "optimization/bundle_adjustment.h"
#include "util/worker.h"

namespace kys_slam {

struct FullBundleOptions {
  bool enabled = true;
  int min_delay = 5;            ///< keyframes from its start until the result is applied
  int keyframes_per_step = 20;  ///< keyframes of the map per additional keyframe of delay
  BundleOptions bundle;
};
/// For check_options().
void describe(kys::OptionList& list, FullBundleOptions& options);

/// Bundle adjustment of a whole sub-map in parallel with the running system (ORB-SLAM2, Sec.
/// III-D). It works on a copy. The result is applied after a number of keyframes that depends on
/// the map alone, so that results do not depend on speed. Keyframes and landmarks added or moved
/// since the start keep their pose relative to their parent or reference keyframe.
class FullBundle {
 public:
  /// \param threaded false: `start` runs the adjustment in the caller's thread
  FullBundle(const FullBundleOptions& options, bool threaded);
  FullBundle(const FullBundle&) = delete;
  FullBundle& operator=(const FullBundle&) = delete;
  ~FullBundle();

  /// Starts with a copy of the sub-map. A running job is dropped.
  void start(const Map& map, KeyFrameId submap, KeyFrameId current);
  /// Applies the result when it is due at this keyframe, and waits for it if necessary. Returns
  /// whether the map was changed.
  bool take_over_if_due(Map& map, KeyFrameId current);
  /// Waits for a running job and applies its result. Returns whether the map was changed.
  bool finish(Map& map);
  void cancel();
  /// Stops this job and all later jobs early; no result is applied any more. Thread-safe.
  void interrupt();

 private:
  struct Job {
    KeyFrameId due;
    KeyFrameId submap;
    RigCorrection rig;
    std::vector<KeyFrameId> keyframes;    // by id
    std::vector<LandmarkId> landmarks;    // by id
    std::vector<Rigid3> T_c_w;            // before
    std::vector<Eigen::Vector3d> points;  // before
    BundleProblem problem;                // after, once done
    BundleSummary summary;
    bool done = false;
  };
  void take_over(Map& map, const Job& job) const;

  FullBundleOptions options_;
  std::unique_ptr<Job> job_;
  std::atomic<bool> stop_{false};
  std::atomic<bool> interrupted_{false};
  std::unique_ptr<Worker> worker_;
};

}  // namespace kys_slam
