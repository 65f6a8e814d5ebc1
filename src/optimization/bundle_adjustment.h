#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <atomic>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// Poses, points and the observations between them, by position in their arrays: what local and
/// full bundle adjustment share. Copied out of the map and back by their callers.
struct BundleProblem {
  struct Observation {
    std::int32_t pose = 0;
    std::int32_t point = 0;
    float u = 0;          ///< px, left image
    float v = 0;          ///< px
    float u_right = 0;    ///< px, right image; NaN for a monocular observation
    float inv_sigma = 1;  ///< 1/px
  };
  StereoCamera camera;
  std::vector<Rigid3> T_c_w;              ///< changed in place, but for the fixed ones
  std::vector<std::uint8_t> pose_fixed;   ///< per pose
  std::vector<Eigen::Vector3d> points;    ///< p_w, m; changed in place
  std::vector<Observation> observations;  ///< grouped by point makes it faster, not different
};

struct BundleOptions {
  int iterations = 5;                       ///< of the robust round
  int refine_iterations = 10;               ///< after outliers are set aside; 0: no second round
  double chi2_mono = 5.991;                 ///< 95 %, 2 degrees of freedom
  double chi2_stereo = 7.815;               ///< 95 %, 3 degrees of freedom
  bool robust = true;                       ///< Huber loss in the first round
  int threads = 1;                          ///< more than one gives no reproducible sums
  const std::atomic<bool>* stop = nullptr;  ///< asked between iterations
};

struct BundleSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  bool stopped = false;  ///< `stop` was set: the poses and points are still valid
  std::vector<std::uint8_t>
      outlier;  ///< per observation: chi2 above the bound or behind the camera
};

/// Minimises the reprojection error over poses and points (ORB-SLAM2, Sec. III-D, III-F).
BundleSummary adjust_bundle(BundleProblem& problem, const BundleOptions& options);

}  // namespace kys_slam
