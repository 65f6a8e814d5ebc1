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
#include "tracking/tracker.h"

namespace kys_slam {

struct ControlOptions {
  int pipeline_delay = 3;   ///< frames after which the tracker sees what the back end did
  bool blend_poses = true;  ///< frames between two keyframes follow both
  int stall_ms = 0;         ///< ms slept in every frame, to study the back end's budget
  std::string label_space = "coco_panoptic_133";
};
/// For check_options().
void describe(kys::OptionList& list, ControlOptions& options);

/// The settings as the parts of the system take them. Ranges are written where each part describes
/// its options: lower ends keep what is divided by, compared or allocated in order; upper ends lie
/// far above what has a use, and keep a typing error (a missing point, one zero too many) from
/// running for days.
struct SettingsData {
  OrbOptions orb;
  StereoOptions stereo;
  TrackerOptions tracking;
  LocalMapperOptions mapping;
  LoopOptions loop;
  FullBundleOptions full_bundle;
  RelocalizationOptions relocalization;
  PlaceVerificationOptions place;  ///< of loops and relocalisation alike
  kys::ModeOptions kys;
  kys::BeliefOptions belief;
  ObjectOptions objects;
  ControlOptions control;
};
/// For check_options().
void describe(kys::OptionList& list, SettingsData& options);

}  // namespace kys_slam
