// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/options.h"

#include <kys_slam/check_options.h>

#include <cmath>

namespace kys_slam {
namespace {

/// All options, in the order of the documentation; the list points into them.
kys::OptionList list_of(BuilderOptions& options) {
  kys::OptionList list;
  describe(list, options);
  return list;
}

constexpr double kLimit = 1e9;

void describe_inputs(kys::OptionList& list, BuilderOptions& o) {
  list.add("association.method", o.association.method, {"centroid", "overlap"}, "");
  list.add("association.max_distance", o.association.max_distance, {0, kLimit}, "px");
  list.add("association.max_missed_frames", o.association.max_missed_frames, {0, kLimit}, "frames");
  list.add("association.class_agnostic", o.association.class_agnostic, "");
  list.add("segments.split_by_depth", o.segments.split_by_depth, "");
  list.add("segments.make_objects", o.segments.make_objects, "");
  list.add("depth.max_depth", o.depth.max_depth, {1e-3, kLimit}, "m");
  list.add("depth.left_right_tolerance", o.depth.left_right_tolerance, {0, kLimit}, "px");
  list.add("depth.match_labels", o.depth.match_labels, "");
  list.add("flow_check.enabled", o.flow_check.enabled, "");
  list.add("flow_check.tolerance", o.flow_check.tolerance, {0, kLimit}, "px");
  list.add("flow_check.relative_tolerance", o.flow_check.relative_tolerance, {0, kLimit});
  list.add("flow_estimate.seeded", o.flow_estimate.seeded, "");
  list.add("flow_estimate.finest_level", o.flow_estimate.finest_level, {-1, 4});
  list.add("ego_motion.model", o.ego_motion.model, {"se3", "rigid", "as_printed"}, "");
  list.add("ego_motion.border", o.ego_motion.border, {0, kLimit}, "px");
  list.add("ego_motion.huber_delta", o.ego_motion.huber_delta, {1e-9, kLimit}, "px");
  list.add("ego_motion.iterations", o.ego_motion.iterations, {1, 1000});
  list.add("ego_motion.grid_samples", o.ego_motion.grid_samples, {0, kLimit}, "px");
  list.add("ego_motion.min_samples", o.ego_motion.min_samples, {8, kLimit}, "px");
  list.add("drift.enabled", o.drift.enabled, "");
  list.add("drift.sigma", o.drift.sigma, {1e-3, 16384}, "px");
  list.add("drift.cell", o.drift.cell, {1, 64}, "px");
}

void describe_decisions(kys::OptionList& list, BuilderOptions::Detection& o) {
  list.add("detection.method", o.method, {"paper", "robust"}, "");
  list.add("detection.references", o.references, {"moments", "robust"}, "");
  list.add("detection.reference_floor", o.reference_floor, {1e-9, kLimit}, "px");
  list.add("detection.robust_factor", o.robust_factor, {1e-9, kLimit});
  list.add("detection.start_log_odds", o.start_log_odds, {-20, 20}, "nats");
  list.add("detection.max_log_odds", o.max_log_odds, {1e-3, 20}, "nats");
  list.add("detection.lag", o.lag, {0, 100}, "frames");
  list.add("detection.min_coverage", o.min_coverage, {0, kLimit});
  list.add("detection.uncovered_factor", o.uncovered_factor, {0, kLimit});
  list.add("detection.min_radial_coverage", o.min_radial_coverage, {0, kLimit});
  list.add("detection.magnitude_factor", o.magnitude_factor, {0, kLimit});
  list.add("detection.radial_factor", o.radial_factor, {0, kLimit});
  list.add("detection.max_omega", o.max_omega, {1, kLimit});
  list.add("detection.max_psi", o.max_psi, {1, kLimit});
  list.add("detection.min_radial_area", o.min_radial_area, {0, kLimit}, "px");
  list.add("detection.min_valid_fraction", o.min_valid_fraction, {0, kLimit});
  list.add("detection.standard_error_factor", o.standard_error_factor, {0, kLimit});
  list.require(std::abs(o.start_log_odds) <= o.max_log_odds,
               "detection.start_log_odds must not be beyond detection.max_log_odds");
}

[[noreturn]] void refuse(const kys::Option& option, const std::string& value) {
  throw InputError("setting " + option.key + ": '" + value + "' is not " + option.expected());
}

}  // namespace

void describe(kys::OptionList& list, BuilderOptions& o) {
  describe_inputs(list, o);
  describe_decisions(list, o.detection);
  list.add("keypoints.features", o.keypoints.features, {100, 50000});
  list.add("keypoints.max_speed", o.keypoints.max_speed, {1e-3, kLimit}, "m/s");
  list.add("keypoints.max_frames", o.keypoints.max_frames, {1, 15}, "frames");
  list.add("keypoints.common_error", o.keypoints.common_error, {0, kLimit}, "px");
  list.add("keypoints.common_disparity_error", o.keypoints.common_disparity_error, {0, kLimit},
           "px");
  list.add("score.factor", o.score.factor, {0, kLimit});
  list.add("score.maximum", o.score.maximum, {0, 100});
  list.add("export.motion_tolerance_steps", o.exported.motion_tolerance_steps, {0, 64});
}

void set_option(BuilderOptions& options, const std::string& name, const std::string& value) {
  for (const kys::OptionList list = list_of(options); const kys::Option& option : list.options()) {
    if (option.key != name) continue;
    if (option.parse(value)) return;
    refuse(option, value);
  }
  throw InputError("setting " + name + ": there is no such setting");
}

void assign_option(BuilderOptions& options, const std::string& assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string::npos) throw InputError("--set " + assignment + ": not KEY=VALUE");
  set_option(options, assignment.substr(0, equals), assignment.substr(equals + 1));
}

std::string to_text(const BuilderOptions& options) {
  BuilderOptions copy = options;
  std::string text;
  for (const kys::OptionList list = list_of(copy); const kys::Option& option : list.options()) {
    text += option.key + ": " + option.text() + "\n";
  }
  return text;
}

void BuilderOptions::check() const {
  check_options(*this);
}

BuilderOptions paper_options() {
  BuilderOptions options;
  options.association.method = AssociationMethod::kCentroid;
  options.association.class_agnostic = true;
  options.flow_check.enabled = false;
  options.ego_motion.model = EgoMotionModel::kAsPrinted;
  options.detection.reference_floor = 1e-9;
  options.detection.uncovered_factor = 0;
  options.exported.motion_tolerance_steps = 0;
  return options;
}

}  // namespace kys_slam
