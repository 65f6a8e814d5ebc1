// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/pose_consensus.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "geometry/so3.h"
#include "synthetic_scene.h"

namespace kys_slam {
namespace {

using test::kitti_camera;
using test::Random;

constexpr double kNoise = 0.3;  // px

/// A street seen from the origin of the world, and the same after the camera has moved by T_c_w.
struct Street {
  Rigid3 T_c_w;
  std::vector<PoseObservation> observations;

  void see(const StereoCamera& camera, const Eigen::Vector3d& p_w, const Eigen::Vector3d& p_c,
           Random& random) {
    const Eigen::Vector3d pixel = camera.project_stereo(p_c);
    const double u = pixel.x() + random.normal(kNoise);
    const double disparity = pixel.x() - pixel.z() + random.normal(kNoise);
    observations.push_back({p_w, static_cast<float>(u),
                            static_cast<float>(pixel.y() + random.normal(kNoise)),
                            static_cast<float>(u - disparity), static_cast<float>(1 / kNoise)});
  }
};

/// `scene` landmarks all over the image at 5 to 60 m, and `mover` landmarks on a truck ahead, 20 %
/// of the image's width, that keeps its distance to the camera.
Street make_street(int scene, int mover, std::uint64_t seed, double wrong_share = 0) {
  const StereoCamera camera = kitti_camera();
  Random random(seed);
  Street street;
  street.T_c_w.translation = {0.02, 0.01, -0.9};
  street.T_c_w.rotation = so3_exp({0.002, 0.004, -0.001});
  while (static_cast<int>(street.observations.size()) < scene) {
    const Eigen::Vector3d p_w = camera.back_project(
        random.uniform(0, camera.width), random.uniform(0, camera.height), random.uniform(5, 60));
    const Eigen::Vector3d p_c = street.T_c_w * p_w;
    const Eigen::Vector3d pixel = camera.project_stereo(p_c);
    if (!camera.in_image(pixel.x(), pixel.y())) continue;
    street.see(camera, p_w, p_c, random);
    if (random.uniform(0, 1) < wrong_share) {  // matched with something else
      PoseObservation& o = street.observations.back();
      o.u = static_cast<float>(random.uniform(0, camera.width));
      o.v = static_cast<float>(random.uniform(0, camera.height));
      o.u_right = o.u - static_cast<float>(random.uniform(3, 60));
    }
  }
  for (int i = 0; i < mover; ++i) {
    const Eigen::Vector3d p =
        camera.back_project(random.uniform(520, 760), random.uniform(60, 300), 11);
    street.see(camera, p, p, random);  // the same place in both images
  }
  return street;
}

double position_error(const Street& street, const Rigid3& T_c_w) {
  return (T_c_w.inverse_t() - street.T_c_w.inverse_t()).norm();
}

TEST(PoseConsensus, AreaWinsOverMatches) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Street street = make_street(150, 450, seed, 0.2);
    const PoseResult votes = optimize_pose(kitti_camera(), {}, street.observations);
    EXPECT_GT(position_error(street, votes.T_c_w), 0.5) << "the truck has three of four matches";
    const ConsensusResult area =
        estimate_pose(kitti_camera(), {}, street.observations, {}, std::nullopt, {});
    EXPECT_TRUE(area.contested);
    EXPECT_TRUE(area.overruled);
    EXPECT_LT(position_error(street, area.pose.T_c_w), 0.02) << "seed " << seed;
    for (std::size_t i = 150; i < street.observations.size(); ++i) {
      ASSERT_EQ(area.pose.outlier[i], 1) << "a feature of the truck is no inlier";
    }
  }
}

/// Corners where a vehicle hides the scene move with the vehicle, and lie one by one all over the
/// image.
TEST(PoseConsensus, CellsOfOneMatchDoNotOutvoteCellsFullOfThem) {
  const StereoCamera camera = kitti_camera();
  Random random(4);
  Street street;
  street.T_c_w.translation = {0.02, 0.01, -0.9};
  const double size = camera.width / 10.0;  // of a cell, px
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 10; ++column) {
      const bool full = (row + column) % 3 == 0;  // ten cells of thirty
      for (int k = 0; k < (full ? 12 : 1); ++k) {
        const double u = (column + random.uniform(0.1, 0.9)) * size;
        const double v = (row + random.uniform(0.1, 0.9)) * size;
        const Eigen::Vector3d p_c = camera.back_project(u, v, random.uniform(5, 15));
        street.see(camera, full ? street.T_c_w.inverse() * p_c : p_c, p_c, random);
      }
    }
  }
  const ConsensusResult area = estimate_pose(camera, {}, street.observations, {}, std::nullopt, {});
  EXPECT_TRUE(area.contested);
  EXPECT_LT(position_error(street, area.pose.T_c_w), 0.02);
}

TEST(PoseConsensus, StaticSceneIsNotTouched) {
  const Street street = make_street(400, 0, 3, 0.1);
  const PoseResult votes = optimize_pose(kitti_camera(), {}, street.observations);
  const ConsensusResult area =
      estimate_pose(kitti_camera(), {}, street.observations, {}, std::nullopt, {});
  EXPECT_FALSE(area.contested);
  EXPECT_EQ(area.pose.T_c_w.translation, votes.T_c_w.translation);
  EXPECT_EQ(area.pose.T_c_w.rotation.coeffs(), votes.T_c_w.rotation.coeffs());
  EXPECT_EQ(area.pose.outlier, votes.outlier);
}

TEST(PoseConsensus, SameAnswerTwice) {
  const Street street = make_street(150, 450, 5, 0.2);
  const auto run = [&] {
    return estimate_pose(kitti_camera(), {}, street.observations, {}, std::nullopt, {}).pose.T_c_w;
  };
  EXPECT_EQ(run().translation, run().translation);
}

/// A vehicle that fills most of the view and moves with the camera.
Street make_full_view(std::uint64_t seed) {
  const StereoCamera camera = kitti_camera();
  Random random(seed);
  Street street;
  street.T_c_w.translation = {0, 0, -0.9};
  for (int i = 0; i < 500; ++i) {
    const double u = random.uniform(0, camera.width);
    const bool mover = u > 450;
    const Eigen::Vector3d p_c =
        camera.back_project(u, random.uniform(0, camera.height), mover ? 6 : random.uniform(5, 40));
    street.see(camera, mover ? p_c : street.T_c_w.inverse() * p_c, p_c, random);
  }
  return street;
}

/// A vehicle so near that it holds the larger part of the area: the past motion decides.
TEST(PoseConsensus, PastMotionDecidesAgainstLargerArea) {
  const StereoCamera camera = kitti_camera();
  const Street street = make_full_view(7);
  const auto error = [&](const std::optional<ExpectedPose>& expected) {
    const Rigid3 start = expected ? expected->T_c_w : Rigid3{};
    return position_error(
        street, estimate_pose(camera, start, street.observations, {}, expected, {}).pose.T_c_w);
  };
  EXPECT_GT(error(std::nullopt), 0.5);
  ExpectedPose expected{street.T_c_w, 0.01};
  expected.T_c_w.translation.z() += 0.02;
  EXPECT_LT(error(expected), 0.02);
}

/// A car that turns in ahead and drives off hardly slower than the camera: its pose and that of the
/// scene are so near that most of the scene's cells fit both within the bound of outliers.
TEST(PoseConsensus, APoseThatNoVehicleCanReachIsContested) {
  const StereoCamera camera = kitti_camera();
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Random random(seed);
    Street street;
    street.T_c_w.translation = {0, 0, -0.5};
    Rigid3 on_car = street.T_c_w;  // of the landmarks that the last frame has left on the car
    on_car.translation.z() = -0.32;
    while (street.observations.size() < 200) {
      const bool car = street.observations.size() < 130;
      const double u = car ? random.uniform(400, 800) : random.uniform(0, camera.width);
      const Eigen::Vector3d p_c =
          camera.back_project(u, random.uniform(0, camera.height),
                              car ? random.uniform(9, 11) : random.uniform(35, 90));
      street.see(camera, (car ? on_car : street.T_c_w).inverse() * p_c, p_c, random);
    }
    const ExpectedPose expected{street.T_c_w, 0.01};  // at 10 Hz
    ConsensusOptions trusting;
    trusting.doubtful_acceleration = 1e9;
    const ConsensusResult led =
        estimate_pose(camera, street.T_c_w, street.observations, {}, expected, trusting);
    EXPECT_FALSE(led.contested) << "seed " << seed;
    EXPECT_GT(position_error(street, led.pose.T_c_w), 0.12) << "the car has most matches";
    const ConsensusResult asked =
        estimate_pose(camera, street.T_c_w, street.observations, {}, expected, {});
    EXPECT_TRUE(asked.overruled) << "seed " << seed;
    EXPECT_LT(position_error(street, asked.pose.T_c_w), 0.08) << "seed " << seed;
  }
}

TEST(PoseConsensus, OffIsThePlainPose) {
  const Street street = make_street(150, 450, 2);
  ConsensusOptions off;
  off.enabled = false;
  const ConsensusResult result =
      estimate_pose(kitti_camera(), {}, street.observations, {}, std::nullopt, off);
  const PoseResult votes = optimize_pose(kitti_camera(), {}, street.observations);
  EXPECT_EQ(result.pose.T_c_w.translation, votes.T_c_w.translation);
  EXPECT_FALSE(result.contested);
}

/// The vehicle as thing 7, with the log-odds of its standing still that a prior file gives it.
std::vector<Vote> votes_of(const Street& street, float log_odds) {
  std::vector<Vote> votes;
  for (const PoseObservation& o : street.observations) {
    votes.push_back(o.u > 450 ? Vote{7, log_odds} : Vote{});
  }
  return votes;
}

TEST(PoseConsensus, AThingCountsOnceHoweverLargeItIs) {
  const Street street = make_full_view(7);
  const auto pose = [&](std::span<const Vote> votes) {
    return estimate_pose(kitti_camera(), {}, street.observations, votes, std::nullopt, {}).pose;
  };
  EXPECT_GT(position_error(street, pose({}).T_c_w), 0.5) << "most of the area is the vehicle's";
  for (const float log_odds : {-1.0f, 0.0f, 1.0f}) {  // flagged, nobody knows, not flagged
    const PoseResult found = pose(votes_of(street, log_odds));
    EXPECT_LT(position_error(street, found.T_c_w), 0.02) << "log-odds " << log_odds;
    for (std::size_t i = 0; i < street.observations.size(); ++i) {
      if (street.observations[i].u > 450) {
        EXPECT_EQ(found.outlier[i], 1);
      }
    }
  }
}

/// The vehicle and what is far away fit the camera that follows the vehicle, and one cell of the
/// road does not: too few features for a sample of three cells.
TEST(PoseConsensus, ThePoseOfTheFixedSceneCompetesByLessThanACell) {
  const StereoCamera camera = kitti_camera();
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Random random(seed);
    Street street;
    street.T_c_w.translation = {0.02, 0.01, -0.9};
    std::vector<Vote> votes;
    const auto add = [&](int count, double u, double v, double depth, bool vehicle) {
      for (int i = 0; i < count; ++i) {
        const Eigen::Vector3d p_c = camera.back_project(
            u + random.uniform(-30, 30), v + random.uniform(-30, 30), depth + random.uniform(0, 2));
        street.see(camera, vehicle ? p_c : street.T_c_w.inverse() * p_c, p_c, random);
        votes.push_back(vehicle ? Vote{7, 1.0f} : Vote{});
      }
    };
    const double cell = camera.width / static_cast<double>(kAreaColumns);
    for (const int column : {2, 3, 4}) add(10, (column + 0.5) * cell, 0.5 * cell, 500, false);
    add(12, 0.5 * cell, 1.5 * cell, 9, false);
    add(300, 4.5 * cell, 1.5 * cell, 11, true);
    const PoseResult votes_alone = optimize_pose(camera, {}, street.observations);
    EXPECT_GT(position_error(street, votes_alone.T_c_w), 0.5) << "the vehicle has most matches";
    const ConsensusResult result =
        estimate_pose(camera, {}, street.observations, votes, std::nullopt, {});
    EXPECT_LT(position_error(street, result.pose.T_c_w), 0.1) << "seed " << seed;
  }
}

TEST(PoseConsensus, AParkedThingCalledMovingStaysWhereItFits) {
  const Street street = make_street(400, 0, 3, 0.1);
  std::vector<Vote> votes;
  for (const PoseObservation& o : street.observations) {
    votes.push_back(o.u > 450 ? Vote{7, -1.0f} : Vote{});
  }
  const PoseResult plain = optimize_pose(kitti_camera(), {}, street.observations);
  const ConsensusResult result =
      estimate_pose(kitti_camera(), {}, street.observations, votes, std::nullopt, {});
  EXPECT_FALSE(result.overruled);
  EXPECT_EQ(result.pose.outlier, plain.outlier);
}

TEST(PoseConsensus, ThingsDecideWhereTheFixedSceneCannot) {
  // Nothing but two vehicles of equal size in view; the prior files call one of them moving.
  const StereoCamera camera = kitti_camera();
  Random random(3);
  Street street;
  street.T_c_w.translation = {0, 0, -0.9};
  std::vector<Vote> votes;
  for (int i = 0; i < 300; ++i) {
    const bool mover = i < 150;
    const double u = mover ? random.uniform(0, 600) : random.uniform(640, 1240);
    const Eigen::Vector3d p_c =
        camera.back_project(u, random.uniform(0, camera.height), random.uniform(6, 8));
    street.see(camera, mover ? p_c : street.T_c_w.inverse() * p_c, p_c, random);
    votes.push_back(mover ? Vote{1, -1.0f} : Vote{2, 1.0f});
  }
  const auto error = [&](const Rigid3& start) {
    return position_error(
        street,
        estimate_pose(camera, start, street.observations, votes, std::nullopt, {}).pose.T_c_w);
  };
  EXPECT_LT(error({}), 0.02);
  EXPECT_LT(error(street.T_c_w), 0.02);
}

TEST(PoseOptimization, PriorAndObservationsWeighByTheirInformation) {
  const Street street = make_street(60, 0, 4);
  PoseOptions options;
  const PoseResult alone = optimize_pose(kitti_camera(), street.T_c_w, street.observations);
  PosePrior prior{alone.T_c_w, 0.002, 0.0002};
  prior.T_c_w.translation += Eigen::Vector3d(0.005, -0.003, 0.01);
  options.prior = prior;
  const PoseResult both = optimize_pose(kitti_camera(), street.T_c_w, street.observations, options);
  ASSERT_EQ(both.outlier, alone.outlier);
  // Both are quadratic here: x = (H + W)^-1 W e, in the increment p_c -> exp(w) p_c + v.
  Eigen::Matrix<double, 6, 6> change = Eigen::Matrix<double, 6, 6>::Identity();
  change.bottomLeftCorner<3, 3>() = -hat(alone.T_c_w.translation);
  const Eigen::Matrix<double, 6, 6> H = change.transpose() * alone.information * change;
  Eigen::Matrix<double, 6, 1> W;
  W.head<3>().setConstant(1 / (0.0002 * 0.0002));
  W.tail<3>().setConstant(1 / (0.002 * 0.002));
  Eigen::Matrix<double, 6, 1> e;
  e << Eigen::Vector3d::Zero(), prior.T_c_w.translation - alone.T_c_w.translation;
  const Eigen::Matrix<double, 6, 1> x =
      (H + Eigen::Matrix<double, 6, 6>(W.asDiagonal())).ldlt().solve(W.cwiseProduct(e));
  const Rigid3 expected(so3_exp(x.head<3>()) * alone.T_c_w.rotation,
                        so3_exp(x.head<3>()) * alone.T_c_w.translation + x.tail<3>());
  EXPECT_GT(x.tail<3>().norm(), 0.001) << "the prior has a say";
  EXPECT_LT((both.T_c_w.inverse_t() - expected.inverse_t()).norm(), 0.02 * x.tail<3>().norm());
}

TEST(PoseOptimization, PositionSigmaIsTheSpreadOfPositions) {
  constexpr int kTrials = 300;
  std::vector<Eigen::Vector3d> centres;
  double sigma = 0;
  for (int k = 0; k < kTrials; ++k) {
    // The same landmarks with other noise.
    Street street = make_street(80, 0, 11);
    Random random(1000 + static_cast<std::uint64_t>(k));
    std::vector<PoseObservation> seen;
    Street again{street.T_c_w, {}};
    for (const PoseObservation& o : street.observations) {
      again.see(kitti_camera(), o.p_w, street.T_c_w * o.p_w, random);
    }
    PoseOptions all;  // no outliers: the formula is that of least squares
    all.chi2_stereo = 1e9;
    const PoseResult pose = optimize_pose(kitti_camera(), street.T_c_w, again.observations, all);
    centres.push_back(pose.T_c_w.inverse_t());
    sigma += position_sigma(pose) / kTrials;
  }
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& c : centres) mean += c / kTrials;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& c : centres) {
    covariance += (c - mean) * (c - mean).transpose() / (kTrials - 1);
  }
  const double spread =
      std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues().z());
  EXPECT_NEAR(sigma / spread, 1, 0.15) << "of 300 samples the spread is known to 4 %";
  EXPECT_TRUE(std::isinf(position_sigma(PoseResult{})));
}

TEST(PoseConsensus, ToleratesNothingUsable) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(estimate_pose(kitti_camera(), {}, {}, {}, std::nullopt, {}).pose.inliers, 0);
  std::vector<PoseObservation> bad(30, PoseObservation{{0, 0, -1}, 10, 10, nan, 1});
  EXPECT_EQ(estimate_pose(kitti_camera(), {}, bad, {}, std::nullopt, {}).pose.inliers, 0);
  for (PoseObservation& o : bad) o.u = nan;
  EXPECT_EQ(estimate_pose(kitti_camera(), {}, bad, {}, std::nullopt, {}).pose.inliers, 0);
}

TEST(PoseOptimization, ShareIsAFactorOnTheInformation) {
  const Street street = make_street(200, 0, 4);
  std::vector<PoseObservation> twice = street.observations;
  twice.insert(twice.end(), street.observations.begin(), street.observations.end());
  for (PoseObservation& o : twice) o.share = 0.5f;
  const PoseResult once = optimize_pose(kitti_camera(), {}, street.observations);
  const PoseResult half = optimize_pose(kitti_camera(), {}, twice);
  EXPECT_LT((once.T_c_w.translation - half.T_c_w.translation).norm(), 1e-6);
  EXPECT_LT((once.information - half.information).norm(), 1e-4 * once.information.norm());
  EXPECT_EQ(half.inliers, 2 * once.inliers);
}

}  // namespace
}  // namespace kys_slam
