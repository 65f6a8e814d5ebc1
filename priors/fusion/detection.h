// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>

#include "priors/fusion/options.h"

namespace kys_slam {

/// Medians over the pixels of a segment, robust against outliers.
struct MedianResidual {
  double length = 0;     ///< px, median length of the corrected residual
  double coherent = 0;   ///< px, length of the residual whose components are the medians
  double scatter = 0;    ///< px, median distance from that
  double parallax = 0;   ///< px, median length of the depth-dependent flow
  double disparity = 0;  ///< px, median
};

/// Evidence of stereo keypoints for one thing segment, from its frame and earlier ones.
struct KeypointEvidence {
  int matches = 0;       ///< keypoints of the segment tracked over time; 0: not compared
  int inliers = 0;       ///< of these, those that fit one rigid motion
  double log_ratio = 0;  ///< nats, > 0: static (src/motion/README.md); share of this frame
  double span = 0;       ///< s between the two frames compared
  double shift = 0;      ///< m over the span, motion of the segment's centre
  double pixels = 0;     ///< px, the same across the line of sight
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< m/s in the world, axes of the camera
  double velocity_sigma = 0;  ///< m/s, standard deviation of it along its worst axis
};

/// Evidence of the next image (appearance.h).
struct AppearanceEvidence {
  int patches = 0;       ///< compared at the end of the static flow
  int flow_patches = 0;  ///< of these, compared at the end of the observed flow
  double still = 0;      ///< 0..1, share of `patches` that match there
  double flow = 0;       ///< 0..1, share of `flow_patches` that match there
};

/// Evidence of the depth of an earlier frame at the present position of an object (free_space.h).
struct FreeSpaceEvidence {
  int occupied = 0;  ///< pixels whose position was occupied
  int free = 0;      ///< pixels whose position was free
  int hidden = 0;    ///< pixels whose position was occluded
  double span = 0;   ///< s, back to that frame
};

/// Measurements over the pixels of one segment.
struct SegmentStatistics {
  std::uint32_t area = 0;         ///< px
  std::uint32_t depth_count = 0;  ///< px with depth
  double mean_depth = 0;          ///< m, over these
  std::uint32_t flow_count = 0;   ///< px with a residual
  double residual = 0;            ///< px, mean length of the corrected residual
  double radial = 0;              ///< px, mean of its part along the predicted flow
  double coverage = 0;            ///< 0..1, mean of the smoothed stuff mask
  MedianResidual median;
  KeypointEvidence keypoints;
  AppearanceEvidence appearance;
  FreeSpaceEvidence space;
};

/// The background of one frame and camera, over its stuff pixels.
struct BackgroundReferences {
  double m_bg = 0;       ///< px, mean length of the corrected residual
  double mu_par = 0;     ///< px, mean radial residual
  double sigma_par = 0;  ///< px, its standard deviation
  double pixels = 0;
};

/// Result of Eqs. 7 and 8 for one thing segment.
struct MotionDecision {
  double omega = 1;  ///< threshold multiplier of the coverage
  bool magnitude_test = false;
  bool radial_test = false;
  bool dynamic = false;
  bool radial_only = false;
  double rho = 0;    ///< residual over background, 0..100
  double score = 0;  ///< m_k, 0..100; detection.method robust: 100 times the probability of moving
  bool judged = false;  ///< false: no measurement of its motion
  double log_odds = 0;  ///< nats, of moving, robust only; evidence of this frame, nats:
  double evidence = 0;  ///< of its object, all cameras and sources; of this segment:
  double evidence_flow = 0, evidence_appearance = 0, evidence_keypoints = 0, evidence_space = 0;
};

/// omega = clip(1 / (c + 0.1), 1, 4).
double coverage_scale(const BuilderOptions::Detection& options, double coverage);
/// psi = clip(2 |mu_par| / sigma_par, 1, 5).
double rotation_guard(const BuilderOptions::Detection& options, const BackgroundReferences& bg);
/// rho = clip(r / m_bg, 0, 100).
double residual_ratio(double residual, double m_bg);
/// Eq. 8: m = min(5 ln^2(1 + rho), 100).
double motion_score(const BuilderOptions::Score& options, double rho);

/// Eqs. 7 and 8 for one thing segment.
MotionDecision decide(const BuilderOptions& options, const SegmentStatistics& segment,
                      const BackgroundReferences& background);

/// Eq. 3: a = area x (mean depth)^2, px^2 m^2; 0 without depth.
float depth_compensated_scale(const SegmentStatistics& segment);

}  // namespace kys_slam
