// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/rig_rows.h>
#include <kys_slam/util/median.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

namespace kys_slam {

namespace {

constexpr int kRounds = 10;
constexpr double kGaussian = 1.4826;  // standard deviation over median absolute deviation
constexpr double kLeastSigma = 0.05;  // px, of rows of the finest octave
// Cauchy's weight 1 / (1 + (e / (kCauchy sigma))^2): 95 % efficient with Gaussian errors.
constexpr double kCauchy = 2.385;

double robust_sigma(const std::vector<double>& residuals) {
  std::vector<double> magnitudes;
  magnitudes.reserve(residuals.size());
  for (const double e : residuals) magnitudes.push_back(std::abs(e));
  return magnitudes.empty() ? 0 : kGaussian * median(magnitudes);
}

}  // namespace

RigCorrection::Covariance rig_prior() {
  RigCorrection::Covariance prior = RigCorrection::Covariance::Zero();
  const auto at = [](RigParameter p) { return static_cast<int>(p); };
  const auto set = [&](RigParameter p, double sigma) { prior(at(p), at(p)) = sigma * sigma; };
  for (const RigParameter k1 : {RigParameter::kLeftK1, RigParameter::kRightK1}) set(k1, 0.01);
  for (const RigParameter k2 : {RigParameter::kLeftK2, RigParameter::kRightK2}) set(k2, 0.005);
  for (const RigParameter p : {RigParameter::kLeftP1, RigParameter::kLeftP2, RigParameter::kRightP1,
                               RigParameter::kRightP2}) {
    set(p, 0.003);
  }
  // Lenses of one rig are of one kind, and their calibrations come from the same images.
  prior(at(RigParameter::kLeftK1), at(RigParameter::kRightK1)) =
      prior(at(RigParameter::kRightK1), at(RigParameter::kLeftK1)) = 0.7 * 0.01 * 0.01;
  set(RigParameter::kYaw, 0.01);
  set(RigParameter::kPitch, 0.01);
  set(RigParameter::kRoll, 0.005);
  set(RigParameter::kRatio, 0.002);
  set(RigParameter::kOffset, 0.5);
  set(RigParameter::kRow, 1.5);
  set(RigParameter::kBaselineY, 0.005);
  set(RigParameter::kBaselineZ, 0.005);
  set(RigParameter::kFocal, 0.005);
  return prior;
}

RigCorrection::Covariance root_of(const RigCorrection::Covariance& covariance) {
  RigCorrection::Covariance L = RigCorrection::Covariance::Zero();
  for (int c = 0; c < RigCorrection::kSize; ++c) {
    const double pivot = covariance(c, c) - L.row(c).squaredNorm();
    if (!(pivot > 1e-12 * covariance(c, c))) continue;
    L(c, c) = std::sqrt(pivot);
    for (int r = c + 1; r < RigCorrection::kSize; ++r) {
      L(r, c) = (covariance(r, c) - L.row(r).head(c).dot(L.row(c).head(c))) / L(c, c);
    }
  }
  return L;
}

RowFit fit_rows(const StereoCamera& given, std::span<const RowObservation> observations,
                const RigEstimate& start) {
  constexpr int kSize = RigCorrection::kSize;
  using Parameters = RigCorrection::Parameters;
  RowFit fit;
  fit.rig = {RigCorrection(given, start.correction.parameters()), start.covariance};
  fit.observations = observations.size();
  if (observations.empty()) return fit;
  // The parameters are start + L x with x of unit prior: those of no variance stay.
  const RigCorrection::Covariance root = root_of(start.covariance);
  const auto residuals = [&](const RigCorrection& rig) {
    std::vector<double> rows;
    rows.reserve(observations.size());
    for (const RowObservation& o : observations) rows.push_back(rig.pair(o.measured).row);
    return rows;
  };
  const auto scaled = [&](std::vector<double> rows) {
    for (std::size_t i = 0; i < rows.size(); ++i) rows[i] /= observations[i].scale;
    return rows;
  };
  const std::vector<double> before = residuals(fit.rig.correction);
  fit.sigma_before = robust_sigma(before);
  Parameters x = Parameters::Zero();
  RigCorrection::Covariance H;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<double> rows = residuals(fit.rig.correction);
    const double sigma = std::max(robust_sigma(scaled(rows)), kLeastSigma);
    H = RigCorrection::Covariance::Identity();
    Parameters b = x;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double unit = sigma * observations[i].scale;
      const double off = rows[i] / (kCauchy * unit);
      const double weight = 1 / ((1 + off * off) * unit * unit);
      const Parameters g =
          (fit.rig.correction.jacobian(observations[i].measured).row(3) * root).transpose();
      H.noalias() += weight * g * g.transpose();
      b += weight * rows[i] * g;
    }
    const Parameters step = H.llt().solve(b);
    x -= step;
    fit.rig.correction = RigCorrection(given, start.correction.parameters() + Parameters(root * x));
    if (step.norm() < 1e-4 * std::sqrt(static_cast<double>(kSize))) break;
  }
  fit.rig.covariance = root * H.llt().solve(RigCorrection::Covariance(root.transpose()));
  const std::vector<double> after = residuals(fit.rig.correction);
  fit.sigma_after = robust_sigma(after);
  for (std::size_t i = 0; i < after.size(); ++i) {
    const double changed = before[i] - after[i];
    fit.field += changed * changed / static_cast<double>(after.size());
  }
  fit.field = std::sqrt(fit.field);
  return fit;
}

}  // namespace kys_slam
