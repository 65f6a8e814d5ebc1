// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <atomic>
#include <optional>

#include "loop_closing/place_verification.h"
#include "loop_closing/submap_joint.h"
#include "map/map.h"
#include "mapping/fusion.h"
#include "mapping/local_bundle.h"
#include "optimization/pose_graph.h"
#include "retrieval/place_index.h"

namespace kys_slam {

struct LoopOptions {
  bool enabled = true;
  int min_gap = 10;                  ///< keyframes between two loops
  std::size_t candidates = 3;        ///< number of candidates of the place index that are verified
  int min_votes = 15;                ///< features that vote for a candidate; fewer: not verified
  std::size_t neighbours = 5;        ///< covisible keyframes that are tested for confirmation
  int min_confirming = 2;            ///< number of these that must confirm
  int min_neighbour_inliers = 25;    ///< landmarks of the place that each must match
  double max_neighbour_shift = 0.1;  ///< m, and share of its distance from the keyframe
  double max_neighbour_turn = 2;     ///< deg, between its verified and its expected orientation
  /// Largest error of the path since the place, as a share of its length; a loop with a larger one
  /// is of another place that appears the same. Stereo odometry drifts by 0.02 at most.
  double max_drift = 0.1;
  double min_allowed_drift = 0.5;  ///< m, allowed for short paths too
  int essential_weight = 100;      ///< shared landmarks of an edge of the essential graph
  int graph_iterations = 20;
  PlaceVerificationOptions verification;
  JointOptions joint;  ///< of two sub-maps
  FusionOptions fusion{10, 0, 4, 50};
};
/// For check_options().
void describe(kys::OptionList& list, LoopOptions& options);

/// Times (ms) and result of loop closing for one keyframe.
struct LoopReport {
  double query = 0;
  double verify = 0;
  double correct = 0;
  int candidates = 0;                ///< places verified
  std::optional<KeyFrameId> closed;  ///< keyframe the loop was closed with
  std::int64_t closed_frame = 0;     ///< its frame
  bool merged = false;               ///< ... which belonged to another sub-map
  double distance = 0;               ///< m, between the two keyframes as verified
  double gap = 0;                    ///< m, translation error that the loop corrected
  double gap_deg = 0;
  int fused = 0;  ///< landmarks
  kys::Statistics statistics;
  [[nodiscard]] double total() const { return query + verify + correct; }
};

/// Recognises that a new keyframe is at a known place and corrects the map: drift within a sub-map
/// is distributed over the essential graph, and two sub-maps are merged (ORB-SLAM, Sec. VII;
/// ORB-SLAM3, Sec. VI). Over SE(3), because stereo observes scale. Owns no thread.
class LoopCloser {
 public:
  /// \param model must outlive the closer
  LoopCloser(const LoopOptions& options, const LocalBundleOptions& bundle,
             const kys::DistanceModel& model)
      : options_(checked(options)), bundle_(checked(bundle)), model_(&model) {}

  /// Call it after local mapping of the keyframe.
  /// \param index of the landmarks of the map
  LoopReport process(Map& map, KeyFrameId current, const PlaceIndex& index,
                     const std::atomic<bool>* stop = nullptr);
  /// Searches the place of a keyframe in the other sub-maps alone; call it when all keyframes
  /// around it are known.
  LoopReport join(Map& map, KeyFrameId current, const PlaceIndex& index,
                  const std::atomic<bool>* stop = nullptr);
  /// Joins a sub-map with another one at a frame that is verified in that one: where the frame is
  /// in the sub-map says where the sub-map is.
  /// \param features of the frame
  /// \param there the frame in the other sub-map
  /// \param current the last keyframe of the sub-map to be joined
  LoopReport join_at(Map& map, const FrameFeatures& features, const VerifiedPlace& there,
                     KeyFrameId current, const std::atomic<bool>* stop = nullptr);

 private:
  struct Confirmed {
    VerifiedPlace place;                 // of the current keyframe
    std::vector<KeyFrameId> neighbours;  // that confirmed it
  };
  [[nodiscard]] std::optional<Confirmed> detect(const Map& map, KeyFrameId current,
                                                const PlaceIndex& index, LoopReport& report) const;
  [[nodiscard]] std::optional<Confirmed> detect_joint(const Map& map, KeyFrameId current,
                                                      const PlaceIndex& index,
                                                      LoopReport& report) const;
  void apply(Map& map, KeyFrameId current, const Confirmed& loop, LoopReport& report,
             const std::atomic<bool>* stop);
  [[nodiscard]] std::optional<Confirmed> confirm(const Map& map, KeyFrameId current,
                                                 VerifiedPlace place,
                                                 kys::Statistics& statistics) const;
  [[nodiscard]] bool is_plausible(const Map& map, KeyFrameId current,
                                  const VerifiedPlace& place) const;
  void close(Map& map, KeyFrameId current, const Confirmed& loop,
             const std::atomic<bool>* stop) const;
  void merge(Map& map, KeyFrameId current, const Confirmed& loop) const;
  int fuse(Map& map, KeyFrameId current, const Confirmed& loop, LoopReport& report) const;

  LoopOptions options_;
  LocalBundleOptions bundle_;
  const kys::DistanceModel* model_;
  std::optional<KeyFrameId> last_closed_;  // keyframe that closed the last loop
};

}  // namespace kys_slam
