// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>
#include <kys/mode_options.h>
#include <kys/option_list.h>

#include <string>

#include "features/orb_extractor.h"
#include "loop_closing/full_bundle.h"
#include "loop_closing/loop_closer.h"
#include "loop_closing/relocalization.h"
#include "mapping/local_mapper.h"
#include "matching/stereo_matcher.h"
#include "system/object_log.h"
#include "system/segment_options.h"
#include "tracking/front_end.h"
#include "tracking/tracker_options.h"

namespace kys_slam {

struct ControlOptions {
  int pipeline_delay = 1;   ///< frames after which the tracker receives the changes of the back end
  bool blend_poses = true;  ///< frames between two keyframes move with both
  int stall_ms = 0;         ///< ms slept in every frame, to study time budgets of the back end
  std::string label_space = "coco_panoptic_133";
  SegmentOptions segments;
};
/// For check_options().
void describe(kys::OptionList& list, ControlOptions& options);

/// The settings as options of the modules. Each module states the ranges of its options. Lower
/// limits prevent invalid values; upper limits are far above useful values and prevent very long
/// runs after a typing error (a missing point, an extra zero).
struct SettingsData {
  OrbOptions orb;
  StereoOptions stereo;
  RowOptions rows;
  TrackerOptions tracking;
  LocalMapperOptions mapping;
  LoopOptions loop;
  FullBundleOptions full_bundle;
  RelocalizationOptions relocalization;
  PlaceVerificationOptions place;  ///< for loops and relocalisation
  kys::ModeOptions kys;
  kys::BeliefOptions belief;
  ObjectOptions objects;
  ControlOptions control;
};
/// For check_options().
void describe(kys::OptionList& list, SettingsData& options);

}  // namespace kys_slam
