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
  ThinningOptions thinning;
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
class LocalMapper {
 public:
  /// \param model must outlive the mapper
  LocalMapper(const LocalMapperOptions& options, const kys::DistanceModel& model);

  /// Continues a loaded map; call it before the first keyframe. New landmarks get ids after those
  /// of the map, and its disparity offset does not change.
  void continue_map(const Map& map);

  LocalMapperReport process(Map& map, const KeyFrameMessage& message,
                            const std::atomic<bool>* stop = nullptr);
  /// At the end of a run: the last estimate of the disparity offset.
  void start_rig(const RigEstimate& rig) { calibration_.start_rig(rig); }
  [[nodiscard]] const std::optional<OffsetEstimate>& offset() const {
    return calibration_.offset();
  }
  void finish(Map& map, const std::atomic<bool>* stop = nullptr) { calibration_.finish(map, stop); }

 private:
  LocalMapperOptions options_;
  const kys::DistanceModel* model_;
  RecentLandmarks recent_;
  RigCalibration calibration_;
  Thinning thinning_;
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kBackEnd};
};

/// Inserts a keyframe and its new landmarks into the map. Its pose is the measured relative pose
/// composed with the present pose of the reference keyframe.
void insert_keyframe(Map& map, const KeyFrameMessage& message);

}  // namespace kys_slam
