// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/system.h>

#include <nlohmann/json.hpp>
#include <string>

namespace kys_slam {

/// What the images said about the calibration, and what is corrected: key `rig` of summary.json.
nlohmann::ordered_json rig_json(const RigReport& report);

/// The same in one line, for the table of a run; "" when nothing differs from the calibration.
std::string describe_rig(const RigReport& report);

}  // namespace kys_slam
