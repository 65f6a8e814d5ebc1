// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <string>

namespace kys_slam {

/// Model of the static-scene flow (Eq. 6 and two alternatives).
enum class EgoMotionModel {
  kSe3,        ///< exact finite rigid motion, six parameters
  kRigid,      ///< instantaneous rigid flow, eight parameters, consistent signs and aspect terms
  kAsPrinted,  ///< Eq. 6 as printed
};

/// Estimators of the per-frame references of Eq. 7 over the stuff pixels.
enum class References {
  kMoments,  ///< mean, mean, standard deviation (paper)
  kRobust,   ///< median, median, 1.4826 MAD
};

/// Method that gives thing segments identities over time.
enum class AssociationMethod {
  kCentroid,  ///< nearest centroids, each camera separately (paper)
  kOverlap,   ///< overlap of masks, common pixels and keypoints, both cameras together
};

/// How segments are judged.
enum class DetectionMethod {
  kPaper,   ///< Eq. 7: means over the segment, each frame separately
  kRobust,  ///< medians with their error, keypoints, evidence over time
};

/// Every constant of Secs. 3.2-3.3, under the name it has in configs/priors_default.yaml.
struct BuilderOptions {
  struct Association {
    AssociationMethod method = AssociationMethod::kOverlap;
    double max_distance = 100;    ///< px between centroids; of kCentroid
    int max_missed_frames = 5;    ///< a track unmatched in more consecutive frames is dropped
    bool class_agnostic = false;  ///< kCentroid: a car may continue as a truck (paper)
  } association;

  struct Segments {
    bool split_by_depth = false;  ///< things that cover several depths become several (not in the
                                  ///< paper); needs disparity
    bool make_objects = false;  ///< parts of one object become one, and what covers several objects
                                ///< known to move differently is split (not in the paper); needs
                                ///< disparity and method overlap; an object has the class of most
                                ///< of its segments so far
  } segments;

  struct Depth {
    double max_depth = 255;           ///< m, larger depths are set to it
    double left_right_tolerance = 1;  ///< px, where both disparities exist
    bool match_labels = true;         ///< pixels warped to the right view must keep their class
  } depth;

  struct FlowCheck {
    bool enabled = true;               ///< false: flow is used as it comes (paper)
    double tolerance = 1;              ///< px, forward-backward
    double relative_tolerance = 0.02;  ///< of the flow's length, added to it
  } flow_check;

  struct FlowEstimate {     // of flow "dis"
    bool seeded = true;     ///< also start from the flow of the static scene
    int finest_level = -1;  ///< halvings of the images it is refined on; -1: to about 640 px width
  } flow_estimate;

  struct EgoMotion {
    EgoMotionModel model = EgoMotionModel::kSe3;
    int border = 20;         ///< px excluded from the fit on every side
    double huber_delta = 1;  ///< px
    int iterations = 5;      ///< re-weighted solutions, at most
    int grid_samples =
        6000;  ///< pixels sampled on a regular grid, more where few are of the static scene; 0: all
    int min_samples = 200;  ///< with fewer usable pixels, no motion is estimated for the frame
  } ego_motion;

  struct Drift {
    double sigma = 60;  ///< px
    int cell = 8;       ///< px, side of the cells in which residuals are averaged
    bool enabled = true;
  } drift;

  struct Detection {
    DetectionMethod method = DetectionMethod::kPaper;
    References references = References::kMoments;
    double reference_floor = 0.1;      ///< px, of m_bg and sigma_par; 1e-9: none (paper)
    double robust_factor = 1.7;        ///< robust: factor on the median of the background
    double start_log_odds = -0.8;      ///< robust: nats, of moving, of a new object
    double max_log_odds = 5;           ///< robust: nats, limit of the absolute log-odds
    int lag = 3;                       ///< robust: later frames used by the decision of a frame
    double min_coverage = 0.05;        ///< below: static, except:
    double uncovered_factor = 10;      ///< factor on the threshold of the magnitude test below
                                       ///< min_coverage; 0: static (paper)
    double min_radial_coverage = 0.3;  ///< below: no radial test
    double magnitude_factor = 2;
    double radial_factor = 2;
    double max_omega = 4;
    double max_psi = 5;
    int min_radial_area = 0;        ///< px, no radial test for smaller segments (paper: 0)
    double min_valid_fraction = 0;  ///< share of a segment's pixels with a residual (paper: 0)
    double standard_error_factor =
        0;  ///< adds this times sigma_par / sqrt(area / 100 px) to the radial threshold, for the
            ///< larger scatter of small segments (paper: 0)
  } detection;

  struct Keypoints {
    int features = 4000;                   ///< per image
    double max_speed = 30;                 ///< m/s, of objects
    int max_frames = 5;                    ///< largest number of frames between the two compared
    double common_error = 0.5;             ///< px, error common to all keypoints of a segment
    double common_disparity_error = 0.25;  ///< px, the same of their disparities
  } keypoints;

  struct Score {
    double factor = 5;  ///< of ln^2(1 + rho)
    double maximum = 100;
  } score;

  struct Export {
    int motion_tolerance_steps = 2;  ///< see MotionCoding
  } exported;

  /// \throws InputError naming the invalid setting.
  void check() const;
};

/// For check_options().
void describe(kys::OptionList& list, BuilderOptions& options);

/// The values of the paper: configs/priors_paper.yaml.
BuilderOptions paper_options();

/// Sets one option by its dotted name ("ego_motion.model", "rigid").
/// \throws InputError for an unknown name or a value it cannot take.
void set_option(BuilderOptions& options, const std::string& name, const std::string& value);

/// Sets one option as --set gives it, "KEY=VALUE". \throws InputError as set_option() does.
void assign_option(BuilderOptions& options, const std::string& assignment);

/// All options, one "name: value" per line in a fixed order.
std::string to_text(const BuilderOptions& options);

}  // namespace kys_slam
