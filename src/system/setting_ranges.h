#pragma once

#include <array>
#include <optional>
#include <string_view>

namespace kys_slam {

/// Least and greatest sensible value of a numeric setting, both allowed.
struct SettingRange {
  std::string_view key;
  double least;
  double most;
};

// Lower ends keep what is divided by, compared or allocated in order; upper ends lie far above what
// has a use, and keep a slip of the pen (a missing point, one zero too many) from running for days.
inline constexpr std::array kSettingRanges = std::to_array<SettingRange>({
    {"orb.features", 1, 60000},
    {"orb.scale_factor", 1.01, 4},
    {"orb.levels", 1, 32},
    {"orb.fast_threshold", 1, 254},
    {"orb.fast_min_threshold", 1, 254},
    {"stereo.max_distance", 1, 256},
    {"stereo.row_tolerance", 0.1, 100},
    {"stereo.median_cut", 0.1, 1000},
    {"stereo.added_disparity", -100, 100},
    {"tracking.min_start_points", 10, 60000},
    {"tracking.close_baselines", 1, 1e6},
    {"tracking.motion_radius", 0.5, 1000},
    {"tracking.min_motion_matches", 3, 60000},
    {"tracking.min_reference_matches", 3, 60000},
    {"tracking.min_pose_inliers", 3, 60000},
    {"tracking.min_local_inliers", 3, 60000},
    {"tracking.local_radius", 0.1, 100},
    {"tracking.local_ratio", 0.1, 10},
    {"tracking.max_distance", 1, 1e6},
    {"tracking.reference_distance", 1, 1e6},
    {"tracking.reference_ratio", 0.1, 10},
    {"tracking.cell_columns", 1, 1000},
    {"tracking.contested_share", 0, 1},
    {"tracking.consensus_tolerance", 0.1, 100},
    {"tracking.consensus_samples", 0, 100000},
    {"tracking.consensus_seed", 0, 1e18},
    {"keyframes.min_frames", 0, 1e6},
    {"keyframes.max_frames", 0, 1e9},
    {"keyframes.reference_ratio", 0, 1},
    {"keyframes.starved_ratio", 0, 1},
    {"keyframes.tracked_close", 0, 60000},
    {"keyframes.untracked_close", 0, 60000},
    {"keyframes.min_inliers", 3, 60000},
    {"keyframes.max_waiting", 0, 1000},
    {"mapping.min_found_ratio", 0, 1},
    {"mapping.min_observation_weight", 0, 100},
    {"mapping.triangulation_neighbours", 0, 1000},
    {"mapping.min_parallax_cos", 0, 1},
    {"mapping.scale_tolerance", 1, 100},
    {"mapping.triangulation_distance", 0, 1e6},
    {"mapping.fusion_neighbours", 0, 1000},
    {"mapping.fusion_second_neighbours", 0, 1000},
    {"mapping.fusion_radius", 0.1, 1000},
    {"mapping.fusion_distance", 0, 1e6},
    {"mapping.bundle_keyframes", 1, 1000},
    {"mapping.bundle_fixed", 0, 10000},
    {"mapping.bundle_iterations", 0, 1000},
    {"mapping.bundle_refine_iterations", 0, 1000},
    {"mapping.redundant_share", 0, 1},
    {"mapping.redundant_observers", 1, 1000},
    {"calibration.keyframes", 2, 1e9},
    {"calibration.significance", 0, 1e6},
    {"calibration.systematic", 0, 100},
    {"calibration.max_correction", 0, 100},
    {"loop.min_gap", 0, 1e9},
    {"loop.candidates", 0, 100},
    {"loop.min_votes", 0, 60000},
    {"loop.neighbours", 0, 1000},
    {"loop.min_confirming", 0, 1000},
    {"loop.min_neighbour_inliers", 0, 60000},
    {"loop.max_neighbour_shift", 0, 1000},
    {"loop.max_neighbour_turn", 0, 180},
    {"loop.essential_weight", 1, 1e6},
    {"loop.graph_iterations", 0, 1000},
    {"full_bundle.min_delay", 0, 1e9},
    {"full_bundle.keyframes_per_step", 1, 1e9},
    {"full_bundle.iterations", 0, 1000},
    {"full_bundle.refine_iterations", 0, 1000},
    {"motion.pixel_sigma", 0.001, 100},
    {"motion.disparity_sigma", 0.001, 100},
    {"motion.max_chi2", 0.1, 1e6},
    {"motion.min_matches", 3, 60000},
    {"motion.iterations", 1, 1000},
    {"motion.max_frames", 1, 100},
    {"motion.kept_share", 0.01, 1},
    {"motion.max_matches", 3, 60000},
    {"motion.max_speed", 0.01, 1000},
    {"motion.max_turn", 0.001, 100},
    {"motion.search_radius", 0.5, 1000},
    {"motion.max_search", 0.5, 10000},
    {"motion.descriptor_distance", 1, 1e6},
    {"motion.descriptor_ratio", 0.1, 10},
    {"motion.inherit_radius", 0, 1},
    {"belief.change_rate", 0, 100},
    {"belief.max_evidence", 0.001, 100},
    {"belief.max_log_odds", 0.1, 20},
    {"belief.memory", 0, 1e6},
    {"belief.patience", 0, 1e6},
    {"belief.carried", -20, 20},
    {"belief.mobile", -20, 20},
    {"belief.flagged", -20, 20},
    {"belief.unflagged", -20, 20},
    {"objects.min_probability", 0.001, 1},
    {"objects.min_keypoints", 0, 60000},
    {"objects.acceleration_density", 1e-6, 1e6},
    {"objects.start_speed", 0.01, 1000},
    {"objects.surface_sigma", 0.001, 100},
    {"objects.speed_sigma", 0.0001, 100},
    {"objects.gate", 0.01, 1000},
    {"objects.gate_growth", 0, 1000},
    {"objects.restart_gate", 0, 1000},
    {"objects.max_gap", 0.001, 1000},
    {"objects.min_observations", 1, 1000000},
    {"relocalization.candidates", 0, 100},
    {"relocalization.patience", 1, 1e9},
    {"place.descriptor_distance", 1, 1e6},
    {"place.descriptor_ratio", 0.1, 10},
    {"place.min_descriptor_matches", 3, 60000},
    {"place.min_aligned", 3, 60000},
    {"place.wide_radius", 0.5, 1000},
    {"place.narrow_radius", 0.5, 1000},
    {"place.search_distance", 1, 1e6},
    {"place.min_inliers", 3, 60000},
    {"place.min_share", 0, 1},
    {"place.min_area", 0, 1},
    {"place.min_observers", 0, 1000},
    {"place.min_observed", 0, 60000},
    {"place.seed", 0, 1e9},
    {"control.pipeline_delay", 0, 1000},
    {"control.stall_ms", 0, 60000},
});

/// Nothing for settings that are no numbers.
constexpr std::optional<SettingRange> setting_range(std::string_view key) {
  for (const SettingRange& range : kSettingRanges) {
    if (range.key == key) return range;
  }
  return std::nullopt;
}

}  // namespace kys_slam
