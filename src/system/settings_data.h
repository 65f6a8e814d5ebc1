#pragma once

#include <kys/belief.h>
#include <kys/mode_options.h>

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

/// The settings as the parts of the system take them.
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

/// Least and greatest sensible value of a number, both allowed. Lower ends keep what is divided by,
/// compared or allocated in order; upper ends lie far above what has a use, and keep a typing
/// error (a missing point, one zero too many) from running for days.
struct SettingRange {
  double least;
  double most;
};

/// Calls visit(key, reference to the value, range, unit, meaning) for every number and visit(key,
/// reference to the value, unit, meaning) for every truth value and text, but those of kys. A
/// table.
template <typename Data, typename Visitor>
void visit_settings(Data& s, Visitor&& visit) {
  visit("orb.features", s.orb.features, {1, 60000}, "", "keypoints wanted per image");
  visit("orb.scale_factor", s.orb.scale_factor, {1.01, 4}, "", "size ratio of two pyramid levels");
  visit("orb.levels", s.orb.levels, {1, 32}, "", "pyramid levels");
  visit("orb.fast_threshold", s.orb.fast_threshold, {1, 254}, "grey levels", "FAST threshold");
  visit("orb.fast_min_threshold", s.orb.fast_min_threshold, {1, 254}, "grey levels",
        "FAST threshold where a cell finds nothing with the first");
  visit("orb.subpixel", s.orb.subpixel, "", "corners placed to a fraction of a pixel");

  visit("stereo.max_distance", s.stereo.max_distance, {1, 256}, "bits",
        "largest distance of a stereo match");
  visit("stereo.row_tolerance", s.stereo.row_tolerance, {0.1, 100}, "px",
        "half width of the row band, octave 0");
  visit("stereo.refine", s.stereo.refine, "", "sub-pixel disparity by correlation");
  visit("stereo.median_cut", s.stereo.median_cut, {0.1, 1000}, "",
        "matches whose patches differ by more than this times the median go");
  visit("stereo.moving_keypoints", s.stereo.moving_keypoints, {0, 60000}, "",
        "with disparity, per thing that its prior file calls moving (mode verified)");
  visit("stereo.added_disparity", s.stereo.added_disparity, {-100, 100}, "px",
        "a deliberate fault, to see that tests notice");

  visit("tracking.min_start_points", s.tracking.min_start_points, {10, 60000}, "",
        "stereo points to start a map");
  visit("tracking.close_baselines", s.tracking.close_baselines, {1, 1e6}, "baselines",
        "points nearer than this are close: stereo alone places them well");
  visit("tracking.motion_radius", s.tracking.motion_radius, {0.5, 1000}, "px",
        "search radius around a prediction by constant velocity, octave 0");
  visit("tracking.min_motion_matches", s.tracking.min_motion_matches, {3, 60000}, "",
        "matches below which the radius is doubled, then the prediction dropped");
  visit("tracking.min_reference_matches", s.tracking.min_reference_matches, {3, 60000}, "",
        "matches with the reference keyframe below which a frame is lost");
  visit("tracking.min_pose_inliers", s.tracking.min_pose_inliers, {3, 60000}, "",
        "inliers of a predicted pose below which it is dropped");
  visit("tracking.min_local_inliers", s.tracking.min_local_inliers, {3, 60000}, "",
        "inliers with the local map below which a frame is lost");
  visit(
      "tracking.min_held_inliers", s.tracking.min_held_inliers, {3, 60000}, "",
      "the same where the pose is one that constant velocity leads to (tracking.acceleration > 0)");
  visit("tracking.local_radius", s.tracking.local_radius, {0.1, 100}, "",
        "factor on the search radius of local landmarks (2.5 or 4 px, octave 0)");
  visit("tracking.local_ratio", s.tracking.local_ratio, {0.1, 10}, "",
        "best over second best distance");
  visit("tracking.max_distance", s.tracking.max_distance, {1, 1e6}, "bits",
        "largest distance of a match");
  visit("tracking.reference_distance", s.tracking.reference_distance, {1, 1e6}, "bits",
        "largest distance of a match without prediction");
  visit("tracking.reference_ratio", s.tracking.reference_ratio, {0.1, 10}, "",
        "best over second best distance without prediction");

  visit("tracking.align", s.tracking.align, "",
        "keypoints are aligned with what their landmarks look like, where there are images");
  visit("tracking.acceleration", s.tracking.acceleration, {0, 1e6}, "m/s^2",
        "standard deviation about constant velocity, which holds poses that few matches hold and "
        "goes "
        "on where frames are lost; 0: matches alone");
  visit("tracking.turn_acceleration", s.tracking.turn_acceleration, {1e-3, 1e6}, "rad/s^2",
        "the same of the rotation");

  auto& c = s.tracking.consensus;
  visit("tracking.balanced", c.enabled, "",
        "poses agree with most of the image area, not with most matches");
  visit("tracking.cell_columns", c.columns, {1, 1000}, "",
        "square cells across the image that measure area");
  visit("tracking.contested_share", c.contested, {0, 1}, "",
        "share of the area held by outliers from which other motions are tried");
  visit("tracking.consensus_tolerance", c.tolerance, {0.1, 100}, "",
        "factor on the bound of the error within which area supports a pose");
  visit("tracking.consensus_priors", c.by_class, "",
        "modes kys and verified: things that can move count once, by what the priors say, not by "
        "their area");
  visit("tracking.cell_evidence", c.cell_evidence, {0.01, 100}, "nats",
        "what one cell of the fixed scene says for a pose, beside the priors of things");
  visit("tracking.consensus_samples", c.samples, {0, 100000}, "",
        "motions tried where outliers hold much area");
  visit("tracking.consensus_seed", c.seed, {0, 1e9}, "", "of these samples");

  auto& k = s.tracking.keyframes;
  visit("keyframes.min_frames", k.min_frames, {0, 1e6}, "frames", "between two keyframes at least");
  visit("keyframes.max_frames", k.max_frames, {0, 1e9}, "frames", "after which one is made anyway");
  visit("keyframes.reference_ratio", k.reference_ratio, {0, 1}, "",
        "share of the reference keyframe's landmarks below which one is due");
  visit("keyframes.starved_ratio", k.starved_ratio, {0, 1}, "",
        "share below which one is made though the back end is busy");
  visit("keyframes.tracked_close", k.tracked_close, {0, 60000}, "",
        "close points that should be tracked");
  visit("keyframes.untracked_close", k.untracked_close, {0, 60000}, "",
        "close points waiting to be added that call for a keyframe");
  visit("keyframes.min_inliers", k.min_inliers, {3, 60000}, "", "inliers below which none is made");
  visit("keyframes.scarce", k.scarce, {0, 60000}, "",
        "landmarks in a frame below which every new one calls for a keyframe; 0: off");
  visit("keyframes.max_waiting", k.max_waiting, {0, 1000}, "",
        "keyframes the back end may have in hand");

  auto& m = s.mapping;
  visit("mapping.min_found_ratio", m.landmark_culling.min_found_ratio, {0, 1}, "",
        "share of frames in view that must match a new landmark");
  visit("mapping.min_observation_weight", m.landmark_culling.min_observation_weight, {0, 100}, "",
        "observations (stereo counts twice) a landmark needs two keyframes after its making");
  visit("mapping.triangulation_neighbours", m.triangulation.neighbours, {0, 1000}, "",
        "keyframes matched against for new landmarks");
  visit("mapping.min_parallax_cos", m.triangulation.min_parallax_cos, {0, 1}, "",
        "largest cosine between two monocular rays");
  visit("mapping.scale_tolerance", m.triangulation.scale_tolerance, {1, 100}, "",
        "distance ratio against octave ratio, factor either way");
  visit("mapping.triangulation_distance", m.triangulation.matching.max_distance, {0, 1e6}, "bits",
        "largest distance of a match along an epipolar line");
  visit("mapping.fusion_neighbours", m.fusion.neighbours, {0, 1000}, "", "keyframes fused with");
  visit("mapping.fusion_second_neighbours", m.fusion.second_neighbours, {0, 1000}, "",
        "and of each of these");
  visit("mapping.fusion_radius", m.fusion.radius, {0.1, 1000}, "px", "search radius, octave 0");
  visit("mapping.fusion_distance", m.fusion.max_distance, {0, 1e6}, "bits",
        "largest distance of a match");
  visit("mapping.bundle_keyframes", m.bundle.max_keyframes, {1, 1000}, "",
        "keyframes optimised together");
  visit("mapping.bundle_fixed", m.bundle.max_fixed, {0, 10000}, "",
        "keyframes held fixed around them");
  visit("mapping.bundle_iterations", m.bundle.bundle.iterations, {0, 1000}, "",
        "of the robust round");
  visit("mapping.bundle_refine_iterations", m.bundle.bundle.refine_iterations, {0, 1000}, "",
        "after outliers are set aside");
  visit("mapping.redundant_share", m.keyframe_culling.redundant_share, {0, 1}, "",
        "share of redundant landmarks above which a keyframe goes");
  visit("mapping.redundant_observers", m.keyframe_culling.min_observers, {1, 1000}, "",
        "other keyframes that make a landmark redundant");
  visit("mapping.thin_after", m.thinning.patience, {0, 1e9}, "keyframes",
        "since one last shared landmarks with the newest, after which it keeps no features without "
        "landmark; 0: never");

  visit("calibration.enabled", m.calibration.enabled, "",
        "estimate a constant offset of all disparities from the map");
  visit("calibration.keyframes", m.calibration.keyframes, {2, 1e9}, "",
        "in the map when it is first estimated; again at twice that");
  visit("calibration.significance", m.calibration.significance, {0, 1e6}, "standard deviations",
        "by which it has to differ to be applied");
  visit("calibration.systematic", m.calibration.systematic, {0, 100}, "px",
        "standard deviation of its error beside that from noise");
  visit("calibration.max_correction", m.calibration.max_correction, {0, 100}, "px",
        "a larger one is ignored");

  auto& l = s.loop;
  visit("loop.enabled", l.enabled, "", "close loops and merge sub-maps");
  visit("loop.min_gap", l.min_gap, {0, 1e9}, "keyframes", "between two loops");
  visit("loop.candidates", l.candidates, {0, 100}, "", "places verified per keyframe");
  visit("loop.min_votes", l.min_votes, {0, 60000}, "",
        "features voting for a place below which it is skipped");
  visit("loop.neighbours", l.neighbours, {0, 1000}, "", "covisible keyframes asked to confirm");
  visit("loop.min_confirming", l.min_confirming, {0, 1000}, "", "of these have to");
  visit("loop.min_neighbour_inliers", l.min_neighbour_inliers, {0, 60000}, "",
        "landmarks of the place each of them has to see");
  visit("loop.max_neighbour_shift", l.max_neighbour_shift, {0, 1000}, "m, and m/m",
        "between where one is found and where it should be: this much and this share of its "
        "distance");
  visit("loop.max_neighbour_turn", l.max_neighbour_turn, {0, 180}, "deg",
        "between where one is found and where it should be");
  visit("loop.essential_weight", l.essential_weight, {1, 1e6}, "",
        "shared landmarks that make an edge of the pose graph");
  visit("loop.graph_iterations", l.graph_iterations, {0, 1000}, "", "of the pose graph at most");
  visit("full_bundle.enabled", s.full_bundle.enabled, "",
        "bundle adjustment of the whole map after a loop");
  visit("full_bundle.min_delay", s.full_bundle.min_delay, {0, 1e9}, "keyframes",
        "after which its result is taken over ...");
  visit("full_bundle.keyframes_per_step", s.full_bundle.keyframes_per_step, {1, 1e9}, "",
        "... and one more for every so many keyframes of the map");
  visit("full_bundle.iterations", s.full_bundle.bundle.iterations, {0, 1000}, "",
        "of the robust round");
  visit("full_bundle.refine_iterations", s.full_bundle.bundle.refine_iterations, {0, 1000}, "",
        "after outliers are set aside");
  visit("relocalization.enabled", s.relocalization.enabled, "",
        "look for lost frames in the whole map, start a new sub-map when that fails");
  visit("relocalization.candidates", s.relocalization.candidates, {0, 100}, "",
        "places verified per frame");
  visit("relocalization.patience", s.relocalization.patience, {1, 1e9}, "frames",
        "not recognised before one of them starts a new sub-map");
  auto& p = s.place;
  visit("place.descriptor_distance", p.descriptor_distance, {1, 1e6}, "bits",
        "largest distance of a match without prediction");
  visit("place.descriptor_ratio", p.descriptor_ratio, {0.1, 10}, "",
        "best over second best distance");
  visit("place.min_descriptor_matches", p.min_descriptor_matches, {3, 60000}, "",
        "such matches below which it is another place");
  visit("place.min_aligned", p.min_aligned, {3, 60000}, "", "matches that agree on one motion");
  visit("place.wide_radius", p.wide_radius, {0.5, 1000}, "px",
        "search radius after the alignment, octave 0");
  visit("place.narrow_radius", p.narrow_radius, {0.5, 1000}, "px", "after the first refinement");
  visit("place.search_distance", p.search_distance, {1, 1e6}, "bits",
        "largest distance of a match there");
  visit("place.min_inliers", p.min_inliers, {3, 60000}, "", "landmarks that fit the refined pose");
  visit("place.min_share", p.min_share, {0, 1}, "", "of the landmarks that should be in view");
  visit("place.min_area", p.min_area, {0, 1}, "",
        "share of the image area with landmarks in view that has matches");
  visit("place.min_observers", p.min_observers, {0, 1000}, "", "keyframes of the place that ...");
  visit("place.min_observed", p.min_observed, {0, 60000}, "",
        "... see this many of those that fit");
  visit("place.seed", p.seed, {0, 1e9}, "", "of the samples of the alignment");

  auto& i = s.tracking.instances;
  visit("motion.pixel_sigma", i.motion.pixel_sigma, {0.001, 100}, "px",
        "of a keypoint at octave 0, when things are judged");
  visit("motion.disparity_sigma", i.motion.disparity_sigma, {0.001, 100}, "px", "of its disparity");
  visit("motion.max_chi2", i.motion.max_chi2, {0.1, 1e6}, "", "what a match says at most");
  visit("motion.min_matches", i.motion.min_matches, {3, 60000}, "",
        "below which a thing is not judged");
  visit("motion.iterations", i.motion.iterations, {1, 1000}, "", "of a fit");
  visit("motion.max_frames", i.max_frames, {1, 100}, "frames",
        "back over which a thing is compared");
  visit("motion.kept_share", i.kept_share, {0.01, 1}, "",
        "of its matches that a longer span has to keep");
  visit("motion.max_matches", i.max_matches, {3, 60000}, "",
        "keypoints of a thing followed at most");
  visit("motion.max_speed", i.max_speed, {0.01, 1000}, "m/s", "of things not seen to move before");
  visit("motion.max_turn", i.max_turn, {0.001, 100}, "rad/s", "of things");
  visit("motion.max_acceleration", i.max_acceleration, {0, 1000}, "m/s^2",
        "of things seen to move or to stand still");
  visit("motion.search_radius", i.search_radius, {0.5, 1000}, "px",
        "around a predicted keypoint at octave 0");
  visit("motion.max_search", i.max_search, {0.5, 10000}, "px",
        "radius for things of unknown motion");
  visit("motion.descriptor_distance", i.descriptor_distance, {1, 1e6}, "bits",
        "largest of a match");
  visit("motion.descriptor_ratio", i.descriptor_ratio, {0.1, 10}, "",
        "best over second best distance");
  visit("motion.inherit_radius", i.inherit_radius, {0, 1}, "of the width",
        "within which a keypoint without a prior file takes a neighbour's prior");
  visit("belief.change_rate", i.belief.change_rate, {0, 100}, "1/s",
        "of things between standing and moving");
  visit("belief.max_evidence", i.belief.max_evidence, {0.001, 100}, "nats",
        "what one frame says at most");
  visit("belief.max_log_odds", i.belief.max_log_odds, {0.1, 20}, "nats", "belief gets no surer");
  visit("belief.memory", i.memory, {0, 1e6}, "s",
        "without a file after which nothing is inherited");
  visit("belief.patience", m.mover_patience, {0, 1e6}, "s",
        "after which landmarks on a mover leave the map");
  visit("belief.carried", s.belief.carried, {-20, 20}, "nats",
        "log-odds of standing still of things that others move (chairs, bags)");
  visit("belief.mobile", s.belief.mobile, {-20, 20}, "nats", "of people, animals, vehicles");
  visit("belief.flagged", s.belief.flagged, {-20, 20}, "nats",
        "added when the file calls it moving");
  visit("belief.unflagged", s.belief.unflagged, {-20, 20}, "nats", "added when it does not");

  auto& o = s.objects;
  visit("objects.min_probability", o.min_probability, {0.001, 1}, "", "of moving, to be logged");
  visit("objects.min_keypoints", o.min_keypoints, {0, 60000}, "",
        "stereo keypoints of a thing that is logged");
  visit("objects.acceleration_density", o.tracks.acceleration_density, {1e-6, 1e6}, "m^2/s^3",
        "of the white acceleration of the motion model");
  visit("objects.start_speed", o.tracks.start_speed, {0.01, 1000}, "m/s",
        "standard deviation before it is seen");
  visit("objects.surface_sigma", o.tracks.surface_sigma, {0.001, 100}, "m",
        "by which the middle of what is seen of a thing wanders");
  visit("objects.speed_sigma", o.tracks.speed_sigma, {0.0001, 100}, "m/s",
        "added to every velocity seen");
  visit("objects.gate", o.tracks.gate, {0.01, 1000}, "m",
        "between a thing and where it was expected, at most");
  visit("objects.gate_growth", o.tracks.gate_growth, {0, 1000}, "m/s",
        "of the gate while it is not seen");
  visit("objects.restart_gate", o.tracks.restart_gate, {0, 1000}, "m",
        "the same for a thing of the same name that jumped");
  visit("objects.max_gap", o.tracks.max_gap, {0.001, 1000}, "s",
        "without being seen after which it is let go");
  visit("objects.min_observations", o.tracks.min_observations, {1, 1000000}, "",
        "shorter tracks are dropped");

  visit("control.pipeline_delay", s.control.pipeline_delay, {0, 1000}, "frames",
        "after which the tracker sees what the back end did (pipelined)");
  visit("control.blend_poses", s.control.blend_poses, "",
        "frames between two keyframes follow both when the map moves (false: the one before)");
  visit("control.stall_ms", s.control.stall_ms, {0, 60000}, "ms",
        "slept in every frame, a study of budgets");
  visit("control.label_space", s.control.label_space, "", "label space of the prior files");
}

}  // namespace kys_slam
