// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/report.h>

#include <string>

#include "map/frame_features.h"
#include "system/private_access.h"
#include "tracking/integrity_check.h"

namespace kys_slam {

inline constexpr const char* kSameImage = "the left and the right image are the same image";

/// Appends a phrase to a report's warning.
void add_phrase(std::string& text, const std::string& phrase);

/// After the first five frames: a warning when all of them are more than 10 s apart, "" else.
std::string note_of_times(const FrameReports& reports);

/// How far a pose can be relied on, with a warning where a mask may help.
void note_integrity(const IntegrityResult& result, FrameReport& report);

/// Whether a half image that shows nothing does so since what the other camera sees there is
/// shifted to the other half: a near wall without corners. A camera that is dead there leaves the
/// keypoints of the other one without matches.
bool is_by_parallax(const std::string& fault, const FrameFeatures& left, int width);

}  // namespace kys_slam
