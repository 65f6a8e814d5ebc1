// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys/option_list.h>

#include <atomic>
#include <vector>

#include "map/keyframe_message.h"
#include "map/map.h"
#include "mapping/culling.h"
#include "mapping/fusion.h"
#include "mapping/local_bundle.h"
#include "mapping/rig_calibration.h"
#include "mapping/sparsification.h"
#include "mapping/thinning.h"
#include "mapping/triangulation.h"

namespace kys_slam {

struct LocalMapperOptions {
  LandmarkCullingOptions landmark_culling;
  TriangulationOptions triangulation;
  FusionOptions fusion;
  LocalBundleOptions bundle;
  KeyFrameCullingOptions keyframe_culling;
  RigCalibrationOptions calibration;
  SparsificationOptions sparsification;
  ThinningOptions thinning;
  int adjust_frames = 1;      ///< frames between two keyframes that are mapped in full, at least
  double mover_patience = 1;  ///< s, after which landmarks on moving instances are erased
};
/// For check_options().
void describe(kys::OptionList& list, LocalMapperOptions& options);

/// Times (ms) and counts of the steps of local mapping for one keyframe.
struct LocalMapperReport {
  double insert = 0;
  double triangulate = 0;
  double fuse = 0;
  double bundle = 0;
  double cull = 0;
  double calibrate = 0;
  int triangulated = 0;
  int fused = 0;
  int landmarks_culled = 0;
  int keyframes_culled = 0;
  int keyframes_thinned = 0;
  LocalBundleReport bundle_report;
  kys::Statistics statistics;
  [[nodiscard]] double total() const {
    return insert + triangulate + fuse + bundle + cull + calibrate;
  }
};

/// Local mapping (ORB-SLAM, Sec. VI): inserts a keyframe, creates and fuses landmarks, adjusts the
/// local map, culls redundant keyframes. Depends on the map and the message only; owns no thread.
///
/// Keyframes may be many and light: each observation makes landmarks and poses more certain. Then
/// not each is mapped in full, and most are culled when they have left the window of local bundle
/// adjustment (sparsification.h, configs/lean.yaml).
class LocalMapper {
 public:
  /// \param model must outlive the mapper
  LocalMapper(const LocalMapperOptions& options, const kys::DistanceModel& model);

  /// Continues a loaded map; call it before the first keyframe. New landmarks get ids after those
  /// of the map, and its disparity offset does not change.
  void continue_map(const Map& map);

  /// \param behind others wait: the keyframe's observations are added, and no more
  LocalMapperReport process(Map& map, const KeyFrameMessage& message,
                            const std::atomic<bool>* stop = nullptr, bool behind = false);
  /// At the end of a run: the last estimate of the disparity offset. The newest keyframes stay, for
  /// a run that continues the map.
  void finish(Map& map, const std::atomic<bool>* stop = nullptr) {
    calibration_.finish(map, keyframes_seen(map), stop);
  }
  void start_rig(const RigEstimate& rig) { calibration_.start_rig(rig); }
  [[nodiscard]] const std::optional<OffsetEstimate>& offset() const {
    return calibration_.offset();
  }

 private:
  [[nodiscard]] std::size_t keyframes_seen(const Map& map) const {
    return map.keyframes().size() + sparsification_.culled();
  }
  [[nodiscard]] bool is_mapped_in_full(const Map& map, const KeyFrameMessage& message,
                                       bool behind) const;
  void map_in_full(Map& map, KeyFrameId id, LocalMapperReport& report,
                   const std::atomic<bool>* stop);

  LocalMapperOptions options_;
  const kys::DistanceModel* model_;
  RecentLandmarks recent_;
  RigCalibration calibration_;
  Sparsification sparsification_;
  Thinning thinning_;
  std::int64_t mapped_ = -1;  // frame of the last keyframe that was mapped in full
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kBackEnd};
};

/// Inserts a keyframe and its new landmarks into the map. Its pose is the measured relative pose
/// composed with the present pose of the reference keyframe.
void insert_keyframe(Map& map, const KeyFrameMessage& message);

}  // namespace kys_slam
