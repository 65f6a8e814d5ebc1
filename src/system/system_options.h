// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>

#include <cstdint>
#include <string>
#include <vector>

#include "system/back_end.h"
#include "system/settings_data.h"
#include "tracking/tracker.h"

/// The settings as the parts of the system take them.
namespace kys_slam {

/// The settings with distances as strict for the descriptors of an extractor as they are for ORB.
SettingsData as_strict_for(const ExtractorTraits& traits, SettingsData settings);

/// Distances between descriptors, in the mode of the settings. \throws InputError
kys::DistanceModel make_model(const SettingsData& settings);

/// Beliefs before anything is measured; empty in modes that have none. \throws InputError
kys::InitialBelief make_belief_start(const SettingsData& settings, const kys::DistanceModel& model);

RowOptions row_options(const SettingsData& settings);
TrackerOptions tracker_options(const SettingsData& settings);
BackEndOptions back_end_options(const SettingsData& settings);

/// What prior and map files call the label space of a setting, which may be a path. One that cannot
/// be loaded is an error where it is needed, not here.
std::string label_space_name(const std::string& setting);

/// Per label: is it a thing? \throws InputError
std::vector<std::uint8_t> things_of(const std::string& label_space);

}  // namespace kys_slam
