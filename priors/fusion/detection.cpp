// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/detection.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {

double coverage_scale(const BuilderOptions::Detection& options, double coverage) {
  return std::clamp(1.0 / (coverage + 0.1), 1.0, options.max_omega);
}

double rotation_guard(const BuilderOptions::Detection& options, const BackgroundReferences& bg) {
  return std::clamp(2.0 * std::abs(bg.mu_par) / bg.sigma_par, 1.0, options.max_psi);
}

double residual_ratio(double residual, double m_bg) {
  return std::clamp(residual / m_bg, 0.0, 100.0);
}

double motion_score(const BuilderOptions::Score& options, double rho) {
  const double log = std::log1p(rho);
  return std::min(options.factor * log * log, options.maximum);
}

MotionDecision decide(const BuilderOptions& options, const SegmentStatistics& segment,
                      const BackgroundReferences& bg) {
  const BuilderOptions::Detection& o = options.detection;
  MotionDecision decision;
  decision.rho = residual_ratio(segment.residual, bg.m_bg);
  decision.score = motion_score(options.score, decision.rho);
  decision.omega = coverage_scale(o, segment.coverage);
  const bool measured =
      segment.flow_count > 0 && segment.flow_count >= o.min_valid_fraction * segment.area;
  const double threshold = o.magnitude_factor * bg.m_bg * decision.omega;
  if (!measured) return decision;
  decision.judged = true;
  if (segment.coverage < o.min_coverage) {
    // The paper calls it static. But a bus that fills the view has no stuff around it, and moves by
    // far more than any drift that could not be corrected there.
    decision.magnitude_test =
        o.uncovered_factor > 0 && segment.residual > o.uncovered_factor * threshold;
    decision.dynamic = decision.magnitude_test;
    return decision;
  }
  decision.magnitude_test = segment.residual > threshold;
  const double scatter = o.standard_error_factor / std::sqrt(segment.area / 100.0);
  decision.radial_test =
      segment.coverage >= o.min_radial_coverage &&
      segment.area >= static_cast<std::uint32_t>(std::max(0, o.min_radial_area)) &&
      std::abs(segment.radial - bg.mu_par) >
          (o.radial_factor + scatter) * bg.sigma_par * decision.omega * rotation_guard(o, bg);
  decision.dynamic = decision.magnitude_test || decision.radial_test;
  decision.radial_only = decision.radial_test && !decision.magnitude_test;
  return decision;
}

float depth_compensated_scale(const SegmentStatistics& segment) {
  if (segment.depth_count == 0) return 0.0F;
  return static_cast<float>(segment.area * segment.mean_depth * segment.mean_depth);
}

}  // namespace kys_slam
