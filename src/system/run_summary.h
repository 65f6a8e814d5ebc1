// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/run_writer.h>

#include <string>

namespace kys_slam {

/// The text of summary.json.
std::string summary_json(const System& system, Schedule schedule, const RunInfo& info,
                         const RunOutcome& outcome);

}  // namespace kys_slam
