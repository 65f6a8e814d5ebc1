#include "geometry/pnp.h"

#include <cmath>
#include <utility>

#include "geometry/pose_refinement.h"
#include "geometry/ransac.h"
#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

constexpr std::size_t kSampleSize = 3;
constexpr int kRefinements = 8;
constexpr int kRefineIterations = 5;

class Pnp {
 public:
  Pnp(const StereoCamera& camera, std::span<const PnpMatch> matches, const RansacOptions& options)
      : camera_(camera), options_(options), count_(matches.size()) {
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const StereoPixel& x = matches[i].pixel;
      if (!is_usable(matches[i].p_w) || !is_usable(x.u, x.v, x.u_right, x.inv_sigma)) continue;
      usable_.push_back(i);
      terms_.push_back({matches[i].p_w, x});
      rays_.push_back(camera.back_project(x.u, x.v, 1.0).normalized());
    }
  }

  RansacResult run() {
    RansacResult best;
    best.inlier.assign(count_, 0);
    if (usable_.size() < kSampleSize) return best;
    SampleGenerator<kSampleSize> samples(usable_.size(), options_.seed);
    Candidate top;
    int limit = options_.iterations;
    int iterations = 0;
    for (; iterations < limit; ++iterations) {
      const auto [i, j, k] = samples.next();
      for (const Rigid3& T_c_w : solve_p3p({rays_[i], rays_[j], rays_[k]},
                                           {terms_[i].point, terms_[j].point, terms_[k].point})) {
        Candidate candidate = judge(T_c_w);
        if (candidate.score <= top.score) continue;
        refine(candidate);
        top = std::move(candidate);
        limit = ransac_iterations(static_cast<std::size_t>(top.inliers), usable_.size(),
                                  kSampleSize, options_.confidence, options_.iterations);
      }
    }
    best.iterations = iterations;
    if (top.inliers < options_.min_inliers) return best;
    best.success = true;
    best.T = top.T_c_w;
    best.inliers = top.inliers;
    for (std::size_t n = 0; n < usable_.size(); ++n) best.inlier[usable_[n]] = top.inlier[n];
    return best;
  }

 private:
  /// A pose and how it fares, scored as by align_se3_ransac.
  struct Candidate {
    Rigid3 T_c_w;
    double score = 0;
    int inliers = 0;
    std::vector<std::uint8_t> inlier;  // per usable match
  };

  [[nodiscard]] Candidate judge(const Rigid3& T_c_w) const {
    Candidate result{T_c_w, 0, 0, std::vector<std::uint8_t>(terms_.size(), 0)};
    for (std::size_t i = 0; i < terms_.size(); ++i) {
      const double bound =
          std::isnan(terms_[i].pixel.u_right) ? options_.chi2_mono : options_.chi2_stereo;
      const double error = reprojection_chi2(camera_, T_c_w, terms_[i]) / bound;
      if (!(error <= 1.0)) continue;
      result.inlier[i] = 1;
      result.inliers += 1;
      result.score += 1.0 - error;
    }
    return result;
  }

  /// Refines over the inliers as long as the score grows.
  void refine(Candidate& best) const {
    std::vector<ReprojectionTerm> chosen;
    for (int i = 0; i < kRefinements && best.inliers > static_cast<int>(kSampleSize); ++i) {
      chosen.clear();
      for (std::size_t k = 0; k < terms_.size(); ++k) {
        if (best.inlier[k] != 0) chosen.push_back(terms_[k]);
      }
      Candidate refined = judge(refine_pose(camera_, best.T_c_w, chosen, kRefineIterations));
      if (refined.score <= best.score) return;
      best = std::move(refined);
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
