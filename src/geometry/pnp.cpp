#include "geometry/pnp.h"

#include <cmath>

#include "geometry/pose_refinement.h"
#include "geometry/ransac.h"
#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

constexpr std::size_t kSampleSize = 3;
constexpr int kRefinements = 3;
constexpr int kRefineIterations = 5;

class Pnp {
 public:
  Pnp(const StereoCamera& camera, std::span<const PnpMatch> matches, const RansacOptions& options)
      : camera_(camera), options_(options), count_(matches.size()) {
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const StereoPixel& x = matches[i].pixel;
      if (!is_usable(matches[i].p_w) || !is_usable(x.u, x.v, x.u_right, x.inv_sigma)) continue;
      usable_.push_back(i);
      terms_.push_back({matches[i].p_w, x, false});
      rays_.push_back(camera.back_project(x.u, x.v, 1.0).normalized());
    }
  }

  RansacResult run() {
    RansacResult best;
    best.inlier.assign(count_, 0);
    if (usable_.size() < kSampleSize) return best;
    SampleGenerator<kSampleSize> samples(usable_.size(), options_.seed);
    std::vector<std::uint8_t> good;  // per usable match
    std::vector<std::uint8_t> best_good(usable_.size(), 0);
    int limit = options_.iterations;
    int iterations = 0;
    for (; iterations < limit; ++iterations) {
      const auto [i, j, k] = samples.next();
      for (const Rigid3& T_c_w : solve_p3p({rays_[i], rays_[j], rays_[k]},
                                           {terms_[i].point, terms_[j].point, terms_[k].point})) {
        const int inliers = find_inliers(T_c_w, good);
        if (inliers <= best.inliers) continue;
        best.T = T_c_w;
        best.inliers = inliers;
        best_good = good;
        refine(best, best_good);
        limit = ransac_iterations(static_cast<std::size_t>(best.inliers), usable_.size(),
                                  kSampleSize, options_.confidence, options_.iterations);
      }
    }
    best.iterations = iterations;
    best.success = best.inliers >= options_.min_inliers;
    if (!best.success) {
      best.T = Rigid3();
      best.inliers = 0;
      return best;
    }
    for (std::size_t n = 0; n < usable_.size(); ++n) best.inlier[usable_[n]] = best_good[n];
    return best;
  }

 private:
  int find_inliers(const Rigid3& T_c_w, std::vector<std::uint8_t>& good) const {
    good.assign(terms_.size(), 0);
    int inliers = 0;
    for (std::size_t i = 0; i < terms_.size(); ++i) {
      const double bound =
          std::isnan(terms_[i].pixel.u_right) ? options_.chi2_mono : options_.chi2_stereo;
      good[i] = reprojection_chi2(camera_, T_c_w, terms_[i]) <= bound ? 1 : 0;
      inliers += good[i];
    }
    return inliers;
  }

  /// Refines over the inliers as long as that does not lose any.
  void refine(RansacResult& result, std::vector<std::uint8_t>& good) const {
    std::vector<ReprojectionTerm> chosen;
    std::vector<std::uint8_t> refined_good;
    for (int i = 0; i < kRefinements && result.inliers > static_cast<int>(kSampleSize); ++i) {
      chosen.clear();
      for (std::size_t k = 0; k < terms_.size(); ++k) {
        if (good[k] != 0) chosen.push_back(terms_[k]);
      }
      const Rigid3 refined = refine_pose(camera_, result.T, chosen, kRefineIterations);
      const int inliers = find_inliers(refined, refined_good);
      if (inliers < result.inliers) return;
      const bool grown = inliers > result.inliers;
      result.T = refined;
      result.inliers = inliers;
      good.swap(refined_good);
      if (!grown) return;
    }
  }

  const StereoCamera& camera_;
  const RansacOptions& options_;
  std::size_t count_;
  std::vector<std::size_t> usable_;      // matches that are finite
  std::vector<ReprojectionTerm> terms_;  // of those
  std::vector<Eigen::Vector3d> rays_;    // of those, unit length
};

}  // namespace

RansacResult solve_pnp_ransac(const StereoCamera& camera, std::span<const PnpMatch> matches,
                              const RansacOptions& options) {
  return Pnp(camera, matches, options).run();
}

}  // namespace kys_slam
