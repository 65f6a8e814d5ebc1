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
#include "mapping/stereo_calibration.h"
#include "mapping/thinning.h"
#include "mapping/triangulation.h"

namespace kys_slam {

struct LocalMapperOptions {
  LandmarkCullingOptions landmark_culling;
  TriangulationOptions triangulation;
  FusionOptions fusion;
  LocalBundleOptions bundle;
  KeyFrameCullingOptions keyframe_culling;
  StereoCalibrationOptions calibration;
  ThinningOptions thinning;
  double mover_patience = 1;  ///< s after which landmarks on what moves leave the map
};
/// For check_options().
void describe(kys::OptionList& list, LocalMapperOptions& options);

/// ms of the steps of local mapping, and what they did, for one keyframe.
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

/// Takes keyframes in and keeps their neighbourhood accurate and free of redundancy (ORB-SLAM,
/// Sec. VI). A function of the map and the message; owns no thread.
class LocalMapper {
 public:
  /// \param model has to outlive the mapper
  LocalMapper(const LocalMapperOptions& options, const kys::DistanceModel& model);

  /// Before the first keyframe of a map that has been worked on before: landmarks made here get ids
  /// from there on, and the disparity offset is left as it was found then.
  void continue_map(const Map& map);

  LocalMapperReport process(Map& map, const KeyFrameMessage& message,
                            const std::atomic<bool>* stop = nullptr);

 private:
  LocalMapperOptions options_;
  const kys::DistanceModel* model_;
  RecentLandmarks recent_;
  StereoCalibration calibration_;
  Thinning thinning_;
  LandmarkIdAllocator landmark_ids_{LandmarkIdAllocator::Maker::kBackEnd};
};

/// Puts a keyframe and its new landmarks into the map. Its pose is the measured motion from the
/// reference keyframe applied to where the map has that keyframe now.
void insert_keyframe(Map& map, const KeyFrameMessage& message);

}  // namespace kys_slam
