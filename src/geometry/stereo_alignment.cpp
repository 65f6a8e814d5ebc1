// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/stereo_alignment.h"

#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "geometry/absolute_orientation.h"
#include "geometry/pose_refinement.h"
#include "geometry/ransac.h"
#include "geometry/reprojection.h"

namespace kys_slam {

void describe(kys::OptionList& list, RansacOptions& o) {
  const kys::OptionList::Fixed fixed(list);
  list.add("ransac.iterations", o.iterations, {1, 1e6});
  list.add("ransac.confidence", o.confidence, {0, 1});
  list.add("ransac.min_inliers", o.min_inliers, {3, 60000});
  list.add("ransac.chi2_mono", o.chi2_mono, {0.1, 1e6});
  list.add("ransac.chi2_stereo", o.chi2_stereo, {0.1, 1e6});
}
namespace {

constexpr std::size_t kSampleSize = 3;
constexpr int kRefinements = 8;  // refine, then sort inliers anew, while that helps
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
        seen_by_a_.push_back(
            {m.p_b, m.pixel_a, false, stereo_covariance(camera, m.p_b, m.pixel_b)});
        seen_by_b_.push_back({m.p_a, m.pixel_b, true, stereo_covariance(camera, m.p_a, m.pixel_a)});
      }
    }
  }

  RansacResult run() {
    RansacResult best;
    best.inlier.assign(matches_.size(), 0);
    if (usable_.size() < kSampleSize) return best;
    SampleGenerator<kSampleSize> samples(usable_.size(), options_.seed);
    int limit = options_.iterations;
    Candidate top;
    int iterations = 0;
    for (; iterations < limit; ++iterations) {
      const auto T_a_b = solve(samples.next());
      if (!T_a_b) continue;
      Candidate candidate = judge(*T_a_b);
      if (candidate.score <= top.score) continue;
      refine(candidate);
      top = std::move(candidate);
      limit = ransac_iterations(static_cast<std::size_t>(top.inliers), usable_.size(), kSampleSize,
                                options_.confidence, options_.iterations);
    }
    best.iterations = iterations;
    if (top.inliers < options_.min_inliers) return best;
    best.success = true;
    best.T = top.T_a_b;
    best.inliers = top.inliers;
    for (std::size_t k = 0; k < usable_.size(); ++k) best.inlier[usable_[k]] = top.inlier[k];
    return best;
  }

 private:
  /// A motion and how it fares. The score is that of MSAC (Torr and Zisserman 2000): inliers count
  /// the more the better they fit.
  struct Candidate {
    Rigid3 T_a_b;
    double score = 0;
    int inliers = 0;
    std::vector<std::uint8_t> inlier;  // per usable match
  };

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

  /// chi2 over its bound: above one is an outlier.
  [[nodiscard]] double relative_error(const Rigid3& T_a_b, const ReprojectionTerm& term) const {
    const double bound = std::isnan(term.pixel.u_right) ? options_.chi2_mono : options_.chi2_stereo;
    return reprojection_chi2(camera_, T_a_b, term) / bound;
  }

  [[nodiscard]] Candidate judge(const Rigid3& T_a_b) const {
    Candidate result{T_a_b, 0, 0, std::vector<std::uint8_t>(usable_.size(), 0)};
    for (std::size_t k = 0; k < usable_.size(); ++k) {
      const double error_a = relative_error(T_a_b, seen_by_a_[k]);
      if (!(error_a <= 1.0)) continue;
      const double error_b = relative_error(T_a_b, seen_by_b_[k]);
      if (!(error_b <= 1.0)) continue;
      result.inlier[k] = 1;
      result.inliers += 1;
      result.score += 2.0 - error_a - error_b;
    }
    return result;
  }

  /// Refines over the inliers as long as the score grows.
  void refine(Candidate& best) const {
    std::vector<ReprojectionTerm> terms;
    for (int i = 0; i < kRefinements && best.inliers >= static_cast<int>(kSampleSize); ++i) {
      terms.clear();
      for (std::size_t k = 0; k < usable_.size(); ++k) {
        if (best.inlier[k] == 0) continue;
        terms.push_back(seen_by_a_[k]);
        terms.push_back(seen_by_b_[k]);
      }
      Candidate refined = judge(refine_pose(camera_, best.T_a_b, terms, kRefineIterations));
      if (refined.score <= best.score) return;
      best = std::move(refined);
    }
  }

  const StereoCamera& camera_;
  std::span<const PointMatch> matches_;
  const RansacOptions& options_;
  std::vector<std::size_t> usable_;          // matches that are finite
  std::vector<ReprojectionTerm> seen_by_a_;  // of those
  std::vector<ReprojectionTerm> seen_by_b_;
};

}  // namespace

RansacResult align_se3_ransac(const StereoCamera& camera, std::span<const PointMatch> matches,
                              const RansacOptions& options) {
  return Alignment(camera, matches, options).run();
}

}  // namespace kys_slam
