// SPDX-License-Identifier: BSD-3-Clause
#include "refinement.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <random>

#include "position_cost.h"
#include "simulated_recordings.h"

namespace kys_slam {
namespace {

using simulator::RigError;
using testing::kKitti;
using testing::SimulatedDrive;

MapObservations drive(const RigError& error, const SimulatedDrive& options) {
  Recording recording = testing::simulate(error, options);
  MapObservations& map = recording.map;
  map.rig.correction = RigCorrection(kKitti, RigCorrection::Parameters::Zero());
  map.submaps.assign(map.T_c_w.size(), 0);
  for (std::size_t k = 0; k < map.T_c_w.size(); ++k) {
    map.keyframe_ids.push_back(static_cast<std::uint32_t>(k));
    map.timestamps.push_back(0.1 * static_cast<double>(k));
  }
  return map;
}

MapObservations drive(const RigError& error, unsigned seed, int keyframes = 30) {
  SimulatedDrive options;
  options.seed = seed;
  options.keyframes = keyframes;
  return drive(error, options);
}

RefinementOptions with_free(const std::vector<std::string>& groups) {
  RefinementOptions options;
  options.free = parse_groups(groups);
  options.prior = {RigCorrection(kKitti, RigCorrection::Parameters::Zero()), rig_prior()};
  return options;
}

const std::vector<std::string> kAllGroups = {"offset", "intrinsics", "baseline", "rotation",
                                             "distortion"};

double sigma_of(const RigEstimate& rig, RigParameter p) {
  return std::sqrt(rig.covariance(static_cast<int>(p), static_cast<int>(p)));
}

TEST(RigGroups, AreAllParametersEachOnce) {
  std::array<int, RigCorrection::kSize> in{};
  for (const std::string_view name : rig_groups()) {
    const FreeParameters free = parse_groups({std::string(name)});
    for (std::size_t k = 0; k < free.size(); ++k) in.at(k) += free.at(k) ? 1 : 0;
  }
  for (const int count : in) EXPECT_EQ(count, 1);
  EXPECT_THROW(parse_groups({"offset", "lens"}), InputError);
}

TEST(Refinement, FindsAFreeOffsetAndHoldsTheRest) {
  RigError error;
  error.cx = 0.8;  // of the right image: disparities are smaller
  MapObservations map = drive(error, 1);
  const RefinementResult result = refine(map, with_free({"offset"}));
  EXPECT_NEAR(result.after.correction.offset(), 0.8,
              3 * sigma_of(result.after, RigParameter::kOffset));
  EXPECT_LT(sigma_of(result.after, RigParameter::kOffset), 0.1);
  EXPECT_EQ(map.rig.correction, result.after.correction);
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    if (k == static_cast<int>(RigParameter::kOffset) || k == static_cast<int>(RigParameter::kRow)) {
      continue;
    }
    EXPECT_EQ(result.after.correction.parameters()[k], 0) << k;
    EXPECT_EQ(result.after.covariance(k, k), rig_prior()(k, k)) << "no better known than before";
  }
  EXPECT_LT(result.refined.held_out.sigma[2], 0.5 * result.adjusted.held_out.sigma[2]);
  EXPECT_GT(result.refined.held_out.count[0], 300U);
}

/// Parameters of an error but offset and row, which a rotation and principal points share.
RigCorrection::Parameters parameters_of(const RigError& e) {
  RigCorrection::Parameters p;
  p << e.left[0], e.left[1], e.left[2], e.left[3], e.right[0], e.right[1], e.right[2], e.right[3],
      e.yaw, e.pitch, e.roll, e.focal_ratio - 1, 0, 0, e.baseline_y, e.baseline_z, e.focal - 1;
  return p;
}

/// Squared errors of these parameters over their covariance, per parameter.
double normalised_error(const RigEstimate& rig, const RigError& truth) {
  std::vector<int> places;
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const auto p = static_cast<RigParameter>(k);
    if (p != RigParameter::kOffset && p != RigParameter::kRow) places.push_back(k);
  }
  const Eigen::VectorXd off = (rig.correction.parameters() - parameters_of(truth))(places);
  const Eigen::MatrixXd covariance = rig.covariance(places, places);
  return off.dot(covariance.ldlt().solve(off)) / static_cast<double>(places.size());
}

/// Images were compared in rows that do not correspond, and their rows were not measured: the
/// slopes of surfaces bias disparities.
TEST(Refinement, CountsOnErrorsOfDisparitiesByWrongRows) {
  RigError error;
  error.left = {0.004, -0.002, 0.0004, -0.0005};
  error.right = {0.006, -0.003, -0.0005, -0.0008};
  error.pitch = -0.002;
  error.roll = 0.003;
  error.cy = 0.8;
  SimulatedDrive wrong_rows;
  wrong_rows.rows = false;
  wrong_rows.slope = 0.2;
  double sum = 0;
  constexpr std::array kSeeds = {3U, 4U, 5U};  // in 5 a keyframe has a single observation
  for (const unsigned seed : kSeeds) {
    wrong_rows.seed = seed;
    MapObservations map = drive(error, wrong_rows);
    const RefinementResult result = refine(map, with_free(kAllGroups));
    sum += normalised_error(result.after, error);
  }
  EXPECT_LT(sum / kSeeds.size(), 1.6);
  // Where rows are measured disparities count as they are.
  MapObservations measured = drive(error, 1);
  const RefinementResult result = refine(measured, with_free(kAllGroups));
  EXPECT_LT(sigma_of(result.after, RigParameter::kRoll), 2e-4);
}

TEST(Refinement, ATrueCalibrationStays) {
  MapObservations map = drive({}, 2);
  const RefinementResult result = refine(map, with_free(kAllGroups));
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    EXPECT_LT(std::abs(result.after.correction.parameters()[k]),
              3 * std::sqrt(result.after.covariance(k, k)))
        << rig_parameter_names().at(static_cast<std::size_t>(k)).name;
  }
  for (int c = 0; c < 4; ++c) {
    EXPECT_LT(result.refined.held_out.sigma[c], 1.05 * result.adjusted.held_out.sigma[c]);
  }
}

TEST(Refinement, WithoutFreeParametersTheCorrectionStays) {
  MapObservations map = drive({}, 3);
  const RigEstimate before = map.rig;
  RefinementOptions options = with_free({});
  // Poses that are off come back to where the observations have them.
  const std::vector<Rigid3> true_poses = map.T_c_w;
  for (std::size_t k = 1; k < map.T_c_w.size(); ++k) map.T_c_w[k].translation.x() += 0.05;
  const RefinementResult result = refine(map, options);
  EXPECT_EQ(map.rig.correction, before.correction);
  EXPECT_EQ(map.rig.covariance, before.covariance);
  EXPECT_LT(result.refined.used.sigma[0], 0.3 * result.read.used.sigma[0]);
  EXPECT_LT((map.T_c_w[1].translation - true_poses[1].translation).norm(), 0.03);
}

/// Errors of keyframes over their covariances, chi2 / 6.
TEST(Refinement, CovariancesOfKeyframesAreThoseOfTheirErrors) {
  double sum = 0;
  int count = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    MapObservations map = drive({}, seed, 15);
    const std::vector<Rigid3> truth = map.T_c_w;
    RefinementOptions options = with_free({});
    options.covariances = true;
    options.hold_out = 0;
    const RefinementResult result = refine(map, options);
    ASSERT_EQ(result.covariances.size(), truth.size());
    EXPECT_EQ(result.covariances[0].norm(), 0) << "the first is held";
    for (std::size_t k = 1; k < truth.size(); ++k) {
      const Rigid3 off = truth[k] * map.T_c_w[k].inverse();
      Eigen::Matrix<double, 6, 1> e;
      e << so3_log(off.rotation), off.translation;
      sum += e.dot(result.covariances[k].ldlt().solve(e)) / 6;
      ++count;
    }
    // Farther from the first keyframe less is known.
    EXPECT_GT(result.covariances.back().trace(), result.covariances[1].trace());
  }
  EXPECT_GT(sum / count, 0.4);
  EXPECT_LT(sum / count, 1.6);
}

TEST(Refinement, StopsWithTheBestSoFarAndIsTheSameEveryTime) {
  RigError error;
  error.cx = 0.8;
  std::atomic<bool> stop{false};
  RefinementOptions options = with_free({"offset"});
  options.watch.stop = &stop;
  int refined = 0;
  options.watch.progress = [&](int, int, const std::string& what) {
    if (what == "refined" && ++refined == 4) stop = true;
  };
  MapObservations map = drive(error, 4);
  const RefinementResult result = refine(map, options);
  EXPECT_TRUE(result.stopped);
  EXPECT_LT(result.refined.used.sigma[2], result.adjusted.used.sigma[2]);
  MapObservations one = drive(error, 4), two = drive(error, 4);
  const RefinementResult a = refine(one, with_free(kAllGroups));
  const RefinementResult b = refine(two, with_free(kAllGroups));
  EXPECT_EQ(a.after.correction.parameters(), b.after.correction.parameters());
  EXPECT_EQ(a.after.covariance, b.after.covariance);
}

/// A drive with positions, 1 cm each, that alone place the map.
struct PositionedDrive {
  MapObservations map;
  std::vector<Eigen::Vector3d> measured;

  explicit PositionedDrive(unsigned seed) : map(drive({}, seed)) {
    std::fill(map.held.begin(), map.held.end(), std::uint8_t{0});
    for (const Rigid3& T : map.T_c_w) measured.push_back(T.inverse_t());
  }
  /// Keyframes that observe nothing.
  [[nodiscard]] std::vector<std::size_t> blind() const {
    std::vector<std::uint8_t> sees(map.T_c_w.size(), 0);
    for (const auto& o : map.observations) sees[o.keyframe] = 1;
    std::vector<std::size_t> none;
    for (std::size_t k = 0; k < sees.size(); ++k) {
      if (sees[k] == 0) none.push_back(k);
    }
    return none;
  }
  /// \param without keyframes that are given no position
  RefinementResult refine(const std::vector<std::size_t>& without = {}) {
    RefinementOptions options = with_free({});
    options.covariances = true;
    options.more = [&](ceres::Problem& problem, MapProblem& blocks) {
      for (std::size_t k = 0; k < measured.size(); ++k) {
        if (std::find(without.begin(), without.end(), k) != without.end()) continue;
        problem.AddResidualBlock(new PositionCost(measured[k], 1e-4 * Eigen::Matrix3d::Identity()),
                                 nullptr, blocks.pose(k));
      }
    };
    return kys_slam::refine(map, options);
  }
};

/// Positions pull the map to where they are, keyframes without observations as well.
TEST(Refinement, TakesMeasuredPositions) {
  std::size_t blind = 0;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    PositionedDrive drive(seed);
    for (Eigen::Vector3d& p : drive.measured) p += Eigen::Vector3d(0.5, 0.2, -0.3);
    const std::vector<std::size_t> none = drive.blind();
    blind += none.size();
    const RefinementResult result = drive.refine();
    for (std::size_t k = 0; k < drive.measured.size(); ++k) {
      EXPECT_LT((drive.map.T_c_w[k].inverse_t() - drive.measured[k]).norm(), 0.02)
          << "seed " << seed << ", keyframe " << k;
      const Eigen::Matrix<double, 6, 1> variance = result.covariances[k].diagonal();
      EXPECT_LT(variance.tail(3).sum(), 3.001e-4) << "1 cm each";
      if (std::find(none.begin(), none.end(), k) == none.end()) continue;
      EXPECT_GT(variance.head(3).minCoeff(), 1e5) << "a position tells no direction";
    }
  }
  EXPECT_GT(blind, 0U) << "some seeds have keyframes without observations";
}

/// Errors of centres over their covariances, chi2 / 3, with positions that have noise.
TEST(Refinement, CovariancesWithPositionsAreThoseOfTheErrors) {
  double sum = 0;
  int count = 0;
  for (unsigned seed = 1; seed <= 10; ++seed) {
    PositionedDrive drive(seed);
    const std::vector<Eigen::Vector3d> truth = drive.measured;
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal(0, 0.01);
    for (Eigen::Vector3d& p : drive.measured) {
      for (double& x : p) x += normal(random);
    }
    const RefinementResult result = drive.refine();
    for (std::size_t k = 0; k < truth.size(); ++k) {
      // The increment of the centre is -R^T v.
      const Rigid3& T = drive.map.T_c_w[k];
      const Eigen::Vector3d e = T.R() * (T.inverse_t() - truth[k]);
      sum += e.dot(result.covariances[k].bottomRightCorner<3, 3>().ldlt().solve(e)) / 3;
      ++count;
    }
  }
  EXPECT_GT(sum / count, 0.7);
  EXPECT_LT(sum / count, 1.4);
}

/// What nothing measures moves with its neighbour, and its covariance says so.
TEST(Refinement, KeyframesWithoutMeasurementsMoveWithTheRest) {
  bool seen = false;
  for (unsigned seed = 1; seed <= 20 && !seen; ++seed) {
    PositionedDrive drive(seed);
    const Eigen::Vector3d shift(3, 0.2, -2);
    for (Eigen::Vector3d& p : drive.measured) p += shift;
    const std::vector<std::size_t> none = drive.blind();
    if (none.empty()) continue;
    seen = true;
    const RefinementResult result = drive.refine(none);
    for (const std::size_t k : none) {
      EXPECT_LT((drive.map.T_c_w[k].inverse_t() - drive.measured[k]).norm(), 0.1) << k;
      EXPECT_GT(result.covariances[k].diagonal().minCoeff(), 1e5) << "not known";
    }
  }
  EXPECT_TRUE(seen);
}

TEST(PositionCost, DerivativesAreThoseOfIncrements) {
  const Rigid3 T_c_w(so3_exp({0.3, -0.2, 0.5}), {1, 2, 3});
  Eigen::Matrix3d covariance;
  covariance << 0.04, 0.01, 0, 0.01, 0.09, 0.02, 0, 0.02, 0.25;
  const PositionCost cost({0.5, 0.1, -2}, covariance);
  const PoseBlock block = to_block(T_c_w);
  const double* blocks[] = {block.data()};
  Eigen::Vector3d at;
  Eigen::Matrix<double, 3, kPoseSize, Eigen::RowMajor> J;
  double* jacobians[] = {J.data()};
  ASSERT_TRUE(cost.Evaluate(blocks, at.data(), jacobians));
  const Eigen::Vector3d off = T_c_w.inverse_t() - Eigen::Vector3d(0.5, 0.1, -2);
  EXPECT_NEAR(at.squaredNorm(), off.dot(covariance.ldlt().solve(off)), 1e-9);
  for (int k = 0; k < 6; ++k) {
    Eigen::Matrix<double, 6, 1> step = Eigen::Matrix<double, 6, 1>::Zero();
    step[k] = 1e-6;
    PoseBlock moved;
    ASSERT_TRUE(PoseManifold().Plus(block.data(), step.data(), moved.data()));
    const double* there[] = {moved.data()};
    Eigen::Vector3d value;
    ASSERT_TRUE(cost.Evaluate(there, value.data(), nullptr));
    EXPECT_LT(((value - at) / 1e-6 - J.col(k)).norm(), 1e-4) << k;
  }
}

}  // namespace
}  // namespace kys_slam
