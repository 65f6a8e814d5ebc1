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
  int min_delay = 5;            ///< keyframes after its start that the result is taken over ...
  int keyframes_per_step = 20;  ///< ... and one more for so many keyframes of the map
  BundleOptions bundle;
};
/// For check_options().
void describe(kys::OptionList& list, FullBundleOptions& options);

/// Bundle adjustment of a whole sub-map beside the running system. It works on a copy; the result
/// is taken over a number of keyframes later that depends on the map alone, so that the answer does
/// not depend on how fast it was. What was made or moved meanwhile keeps its place relative to what
/// it hangs on (ORB-SLAM2, Sec. III-D).
class FullBundle {
 public:
  /// \param threaded false: `start` does the work itself
  FullBundle(const FullBundleOptions& options, bool threaded);
  FullBundle(const FullBundle&) = delete;
  FullBundle& operator=(const FullBundle&) = delete;
  ~FullBundle();

  /// Begins with a sub-map as it is now; a job under way is dropped.
  void start(const Map& map, KeyFrameId submap, KeyFrameId current);
  /// Takes the result over when it is due at this keyframe, waiting for it if need be. Returns
  /// whether it did.
  bool take_over_if_due(Map& map, KeyFrameId current);
  /// Takes over what is under way, waiting for it.
  bool finish(Map& map);
  void cancel();
  /// Stops the work and all later work early; nothing is taken over any more. From any thread.
  void interrupt();

 private:
  struct Job {
    KeyFrameId due;
    KeyFrameId submap;
    float disparity_offset = 0;
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
