// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <atomic>
#include <cstdint>
#include <vector>

#include "geometry/chi_square.h"
#include "geometry/observation.h"
#include "optimization/motion_term.h"

namespace kys_slam {

/// Poses, points and observations, by index in their arrays. Used by local and full bundle
/// adjustment, which copy them from and to the map. A whole map has millions of observations: they
/// take 16 bytes each.
struct BundleProblem {
  struct Observation {
    float u = 0;        ///< px, left image
    float v = 0;        ///< px
    float u_right = 0;  ///< px, right image; NaN for a monocular observation
    std::uint32_t pose : 24 = 0;
    std::uint32_t noise : 8 = 0;  ///< index in inv_sigma
  };
  StereoCamera camera;
  InformationRatio ratio = {};           ///< of all observations
  std::vector<Rigid3> T_c_w;             ///< changed in place, but for the fixed ones
  std::vector<std::uint8_t> pose_fixed;  ///< per pose
  std::vector<float> inv_sigma;          ///< 1/px, of u; by `noise` of an observation
  std::vector<Eigen::Vector3d> points;   ///< p_w, m; changed in place
  std::vector<float> weights;  ///< per point, 0..1, factor on the cost of its observations; outlier
                               ///< bounds do not depend on it; empty: 1
  std::vector<Observation> observations;  ///< by point
  std::vector<std::int32_t> first{0};     ///< per point its first observation; then their number
  std::vector<MotionTerm> motions;        ///< expected between poses

  /// Adds a point without observations.
  void add_point(const Eigen::Vector3d& p_w) {
    points.push_back(p_w);
    first.push_back(first.back());
  }
  /// Adds an observation of the last point.
  void add_observation(const Observation& o) {
    observations.push_back(o);
    ++first.back();
  }
};

/// Solver of the normal equations. All minimise the same cost.
enum class BundleSolver : std::uint8_t {
  kAuto,         ///< kSchur up to kDenseMaxPoses free poses, kSparseSchur above
  kSchur,        ///< own Levenberg-Marquardt, points eliminated, dense reduced system: windows
  kSparseSchur,  ///< the same with a sparse reduced system: whole maps
};
inline constexpr int kDenseMaxPoses = 150;

struct BundleRound;
struct BundleRoundSummary;
struct BundleOptions;
/// Minimises over a fixed set of observations (bundle_solver.h).
using BundleRoundSolver = BundleRoundSummary (*)(BundleProblem&, const BundleOptions&,
                                                 const BundleRound&);

struct BundleOptions {
  BundleSolver solver = BundleSolver::kAuto;
  int iterations = 5;          ///< of the robust round
  int refine_iterations = 10;  ///< after removal of outliers; 0: no second round
  double chi2_mono = kChi2Mono95;
  double chi2_stereo = kChi2Stereo95;
  bool robust = true;              ///< Huber loss in the first round
  int min_pose_observations = 10;  ///< a pose with fewer does not move
  double disparity_weight = 1;     ///< factor on the information of disparities
  /// after every step, points one by one with the poses held; kSparseSchur always does
  bool iterate_points = false;
  double function_tolerance = 1e-4;  ///< stop when the relative decrease of the cost is smaller
  const std::atomic<bool>* stop = nullptr;   ///< checked every few ms to 100 ms
  BundleRoundSolver round_solver = nullptr;  ///< replaces ours, e.g. by a reference
};
/// For check_options(). \param prefix of the keys
void describe(kys::OptionList& list, BundleOptions& options, std::string_view prefix = "bundle.");

struct BundleSummary {
  double initial_cost = 0;  ///< 1/2 sum of rho(chi2) before the first round
  double final_cost = 0;    ///< 1/2 sum of (rho of) chi2 over the observations of the last round
  int iterations = 0;       ///< of all rounds, rejected steps included
  bool stopped = false;     ///< `stop` was set: the poses and points are still valid
  /// per observation: chi2 above the bound or behind the camera
  std::vector<std::uint8_t> outlier;
  std::vector<std::uint8_t> unconstrained;  ///< per pose: free, not moved for lack of observations
};

/// Minimises the reprojection error over poses and points (ORB-SLAM2, Sec. III-D, III-F): a robust
/// round (Huber at the chi2 bounds), then a least-squares round over the observations within the
/// bounds. Observations that are not finite, or initially behind the camera, are outliers from the
/// start. Points and poses without usable observations do not move. A free pose with fewer than
/// `min_pose_observations`, initially or after removal of outliers, does not move either, and its
/// observations are not used: three wrong matches can move a pose anywhere. If no pose is fixed,
/// the first observed one is held (gauge freedom).
/// \throws std::invalid_argument for indices out of range, arrays of unequal length, a bad camera.
BundleSummary adjust_bundle(BundleProblem& problem, const BundleOptions& options);

}  // namespace kys_slam
