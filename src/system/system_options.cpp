// SPDX-License-Identifier: BSD-3-Clause
#include "system/system_options.h"

#include <kys/error.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>

#include "loop_closing/strict_distances.h"

namespace kys_slam {
namespace {

/// Modes whose poses ask priors what can move: those that use all that a prior file says. Mode
/// mask, the control, drops keypoints and is stock otherwise.
bool asks_what_moves(const SettingsData& settings) {
  switch (settings.kys.mode) {
    case kys::Mode::kKys:
    case kys::Mode::kVerified:
      return !kys::kPriorsOff && settings.tracking.consensus.enabled &&
             settings.tracking.consensus.by_class;
    default:
      return false;
  }
}

}  // namespace

SettingsData as_strict_for(const ExtractorTraits& traits, SettingsData s) {
  const DistanceQuantiles& distances = traits.distances;
  for (float* bits :
       {&s.stereo.max_distance, &s.tracking.max_distance, &s.tracking.reference_distance,
        &s.mapping.triangulation.matching.max_distance}) {
    *bits = equivalent_distance(*bits, distances);
  }
  double& instances = s.tracking.instances.descriptor_distance;
  if (distances.measured()) {
    instances = static_cast<double>(equivalent_distance(static_cast<float>(instances), distances));
  }
  make_strict(distances, s.mapping.fusion);
  make_strict(distances, s.loop);
  make_strict(distances, s.place);
  return s;
}

kys::DistanceModel make_model(const SettingsData& settings) {
  try {
    if (!kys::needs_label_space(settings.kys)) return kys::DistanceModel(settings.kys);
    return {settings.kys, kys::load_label_space(settings.control.label_space)};
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
}

kys::InitialBelief make_belief_start(const SettingsData& settings,
                                     const kys::DistanceModel& model) {
  if (!model.uses_belief() && !asks_what_moves(settings)) return {};
  try {
    return {settings.belief, kys::load_label_space(settings.control.label_space)};
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
}

RowOptions row_options(const SettingsData& settings) {
  RowOptions options = settings.rows;
  options.enabled = options.enabled && settings.mapping.calibration.enabled;
  return options;
}

TrackerOptions tracker_options(const SettingsData& settings) {
  TrackerOptions options = settings.tracking;
  options.consensus.by_class = asks_what_moves(settings);
  return options;
}

std::string label_space_name(const std::string& setting) {
  try {
    return kys::load_label_space(setting).name();
  } catch (const kys::Error&) {
    return setting;
  }
}

std::vector<std::uint8_t> things_of(const std::string& label_space) {
  try {
    std::vector<std::uint8_t> is_thing;
    const kys::LabelSpace space = kys::load_label_space(label_space);
    for (const kys::LabelClass& c : space.classes()) {
      is_thing.push_back(c.thing ? 1 : 0);
    }
    return is_thing;
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
}

BackEndOptions back_end_options(const SettingsData& settings) {
  BackEndOptions options{settings.mapping, settings.loop, settings.full_bundle,
                         settings.relocalization};
  options.mapping.keyframe_culling.close_baselines = settings.tracking.close_baselines;
  options.loop.verification = options.relocalization.verification = settings.place;
  return options;
}

}  // namespace kys_slam
