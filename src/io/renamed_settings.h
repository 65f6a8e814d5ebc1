// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string_view>

namespace kys_slam {

/// A setting of an earlier version, and what it is called now.
struct RenamedSetting {
  std::string_view before;
  std::string_view now;
};

/// Settings with another name than in earlier versions. The earlier name is refused with a message
/// that gives the present one: a setting that is ignored would change results without a word.
inline constexpr std::array kRenamedSettings{
    RenamedSetting{"integrity.rival", "integrity.other_motion_area"},
    RenamedSetting{"integrity.rival_behind", "integrity.other_motion_area_behind"},
    RenamedSetting{"integrity.still", "integrity.max_still_shift"},
    RenamedSetting{"integrity.unexplained", "integrity.outlier_area"},
    RenamedSetting{"keyframes.scarce", "keyframes.min_tracked"},
    RenamedSetting{"tracking.balanced", "tracking.image_area"},
    RenamedSetting{"tracking.contested_share", "tracking.outlier_area"},
    RenamedSetting{"tracking.doubtful_share", "tracking.min_inlier_share"},
    RenamedSetting{"tracking.fallen_share", "tracking.inlier_drop"},
    RenamedSetting{"tracking.held_share", "tracking.expected_share"},
    RenamedSetting{"tracking.hold_share", "tracking.max_relative_sigma"},
    RenamedSetting{"tracking.max_vote", "tracking.max_instance_evidence"},
    RenamedSetting{"tracking.min_held_inliers", "tracking.min_predicted_inliers"},
    RenamedSetting{"tracking.moves_along", "tracking.co_moving_share"},
    RenamedSetting{"tracking.sampled", "tracking.sample_stride"},
    RenamedSetting{"tracking.stays", "tracking.co_moving_step"},
};

}  // namespace kys_slam
