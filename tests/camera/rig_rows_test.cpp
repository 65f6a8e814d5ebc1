// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/rig_rows.h>

#include <cmath>
#include <random>
#include <vector>

#include "support/rig_samples.h"

namespace kys_slam {
namespace {

using testing::bent_rig;
using testing::kitti_like;

/// Matches all over the image, with noise of rows and some that are wrong.
std::vector<RowObservation> matches_of(const RigCorrection& rig, double noise, int count,
                                       unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  std::normal_distribution<double> normal(0, noise);
  std::vector<RowObservation> rows;
  for (int i = 0; i < count; ++i) {
    const double u = 100 + 1100 * unit(random), v = 10 + 350 * unit(random);
    const double disparity = 1 + 60 * unit(random) * unit(random);
    const Eigen::Vector2d left = rig.measured_left(u, v);
    const Eigen::Vector2d right = rig.measured_right(u, v, u - disparity);
    const double wrong = i % 20 == 0 ? 3 * (unit(random) - 0.5) : 0;
    rows.push_back(
        {{static_cast<float>(left.x()), static_cast<float>(left.y()), static_cast<float>(right.x()),
          static_cast<float>(right.y() + normal(random) + wrong)},
         1});
  }
  return rows;
}

TEST(RigRows, RowsOfABentPairAreExplained) {
  const RigCorrection truth = bent_rig(kitti_like());
  const RowFit fit = fit_rows(kitti_like(), matches_of(truth, 0.1, 600, 1), {{}, rig_prior()});
  EXPECT_GT(fit.sigma_before, 0.3);
  EXPECT_LT(fit.sigma_after, 0.12);
  EXPECT_GT(fit.sigma_after, 0.08);
  EXPECT_GT(fit.field, 0.3);
  // Held out: other matches, without noise.
  double squares = 0, normalised = 0;
  const std::vector<RowObservation> others = matches_of(truth, 0, 500, 2);
  int good = 0;
  for (std::size_t i = 0; i < others.size(); ++i) {
    if (i % 20 == 0) continue;
    const double error = fit.rig.correction.pair(others[i].measured).row;
    squares += error * error;
    normalised += std::pow(error / fit.rig.sigma(others[i].measured)[3], 2);
    ++good;
  }
  EXPECT_LT(std::sqrt(squares / good), 0.03) << "px";
  EXPECT_LT(std::sqrt(normalised / good), 1.5);
}

TEST(RigRows, APerfectPairShowsNoField) {
  const RowFit fit = fit_rows(kitti_like(), matches_of({}, 0.1, 600, 3), {{}, rig_prior()});
  EXPECT_LT(fit.field, 0.03);
}

/// A rig that is known already, as from several recordings, and is seen again.
TEST(RigRows, ParametersWithoutVarianceStay) {
  const RigCorrection truth = bent_rig(kitti_like());
  RigEstimate known{truth, RigCorrection::Covariance::Zero()};
  const int row = static_cast<int>(RigParameter::kRow);
  known.covariance(row, row) = 1;
  RigCorrection::Parameters moved = truth.parameters();
  moved[row] += 0.4;
  const RowFit fit = fit_rows(kitti_like(), matches_of({kitti_like(), moved}, 0.1, 400, 4), known);
  EXPECT_NEAR(fit.rig.correction.parameters()[row], moved[row], 0.02);
  RigCorrection::Parameters found = fit.rig.correction.parameters();
  found[row] = truth.parameters()[row];
  EXPECT_EQ(found, truth.parameters());
}

TEST(RigRows, NothingToSeeGivesThePriorBack) {
  const RowFit fit = fit_rows(kitti_like(), {}, {{}, rig_prior()});
  EXPECT_EQ(fit.rig.covariance, rig_prior());
  EXPECT_TRUE(fit.rig.correction.none());
}

TEST(RigRows, TheRootOfACovarianceGivesItBack) {
  RigCorrection::Covariance covariance = rig_prior();
  covariance.row(3).setZero();
  covariance.col(3).setZero();
  const RigCorrection::Covariance L = root_of(covariance);
  EXPECT_LT((L * L.transpose() - covariance).norm(), 1e-12);
  EXPECT_TRUE(L.row(3).isZero());
}

}  // namespace
}  // namespace kys_slam
