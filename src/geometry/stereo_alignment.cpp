#include "geometry/stereo_alignment.h"

#include <array>
#include <cmath>

#include "geometry/absolute_orientation.h"
#include "geometry/pose_refinement.h"
#include "geometry/ransac.h"
#include "geometry/reprojection.h"

namespace kys_slam {
namespace {

constexpr std::size_t kSampleSize = 3;
constexpr int kRefinements = 3;  // refine, then sort inliers anew
constexpr int kRefineIterations = 5;

class Alignment {
 public:
  Alignment(const StereoCamera& camera, std::span<const PointMatch> matches,
            const RansacOptions& options)
      : camera_(camera), matches_(matches), options_(options) {
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const PointMatch& m = matches[i];
      if (is_usable(m.p_a) && is_usable(m.p_b) && is_usable_pixel(m.pixel_a) &&
          is_usable_pixel(m.pixel_b)) {
        usable_.push_back(i);
      }
    }
  }

  RansacResult run() {
    RansacResult best;
    best.inlier.assign(matches_.size(), 0);
    if (usable_.size() < kSampleSize) return best;
    SampleGenerator<kSampleSize> samples(usable_.size(), options_.seed);
    int limit = options_.iterations;
    std::vector<std::uint8_t> inlier;
    int iterations = 0;
    for (; iterations < limit; ++iterations) {
      const auto T_a_b = solve(samples.next());
      if (!T_a_b) continue;
      const int inliers = find_inliers(*T_a_b, inlier);
      if (inliers <= best.inliers) continue;
      best.T = *T_a_b;
      best.inliers = inliers;
      best.inlier = inlier;
      // A sample of noisy points misses inliers: what counts is how many its refinement finds.
      refine(best);
      limit = ransac_iterations(static_cast<std::size_t>(best.inliers), usable_.size(), kSampleSize,
                                options_.confidence, options_.iterations);
    }
    best.iterations = iterations;
    best.success = best.inliers >= options_.min_inliers;
    if (!best.success) {
      best.T = Rigid3();
      best.inliers = 0;
      best.inlier.assign(matches_.size(), 0);
    }
    return best;
  }

 private:
  static bool is_usable_pixel(const StereoPixel& p) {
    return is_usable(p.u, p.v, p.u_right, p.inv_sigma);
  }

  [[nodiscard]] std::optional<Rigid3> solve(
      const std::array<std::size_t, kSampleSize>& sample) const {
    std::array<Eigen::Vector3d, kSampleSize> a;
    std::array<Eigen::Vector3d, kSampleSize> b;
    for (std::size_t i = 0; i < kSampleSize; ++i) {
      a[i] = matches_[usable_[sample[i]]].p_a;
      b[i] = matches_[usable_[sample[i]]].p_b;
    }
    return absolute_orientation(a, b);
  }

  [[nodiscard]] double bound(const StereoPixel& pixel) const {
    return std::isnan(pixel.u_right) ? options_.chi2_mono : options_.chi2_stereo;
  }

  int find_inliers(const Rigid3& T_a_b, std::vector<std::uint8_t>& inlier) const {
    inlier.assign(matches_.size(), 0);
    int inliers = 0;
    for (const std::size_t i : usable_) {
      const PointMatch& m = matches_[i];
      const bool in_a =
          reprojection_chi2(camera_, T_a_b, {m.p_b, m.pixel_a, false}) <= bound(m.pixel_a);
      if (!in_a) continue;
      const bool in_b =
          reprojection_chi2(camera_, T_a_b, {m.p_a, m.pixel_b, true}) <= bound(m.pixel_b);
      inlier[i] = in_b ? 1 : 0;
      inliers += in_b ? 1 : 0;
    }
    return inliers;
  }

  /// Refines over the inliers as long as that does not lose any.
  void refine(RansacResult& result) const {
    std::vector<std::uint8_t> inlier;
    std::vector<ReprojectionTerm> terms;
    for (int i = 0; i < kRefinements && result.inliers >= static_cast<int>(kSampleSize); ++i) {
      terms.clear();
      for (const std::size_t k : usable_) {
        if (result.inlier[k] == 0) continue;
        terms.push_back({matches_[k].p_b, matches_[k].pixel_a, false});
        terms.push_back({matches_[k].p_a, matches_[k].pixel_b, true});
      }
      const Rigid3 refined = refine_pose(camera_, result.T, terms, kRefineIterations);
      const int inliers = find_inliers(refined, inlier);
      if (inliers < result.inliers) return;
      const bool grown = inliers > result.inliers;
      result.T = refined;
      result.inliers = inliers;
      result.inlier.swap(inlier);
      if (!grown) return;
    }
  }

  const StereoCamera& camera_;
  std::span<const PointMatch> matches_;
  const RansacOptions& options_;
  std::vector<std::size_t> usable_;
};

}  // namespace

RansacResult align_se3_ransac(const StereoCamera& camera, std::span<const PointMatch> matches,
                              const RansacOptions& options) {
  return Alignment(camera, matches, options).run();
}

}  // namespace kys_slam
