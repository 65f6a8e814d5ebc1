// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <utility>

#include "ceres_reference/ceres_reference.h"
#include "synthetic_scene.h"

namespace kys_slam::test {
namespace {

struct Solver {
  const char* name;
  BundleSolver own;
  BundleRoundSolver reference;
};

class AdjustBundle : public ::testing::TestWithParam<Solver> {
 protected:
  static BundleOptions options() {
    BundleOptions result;
    result.solver = GetParam().own;
    result.round_solver = GetParam().reference;
    result.iterations = 20;
    result.refine_iterations = 20;
    result.function_tolerance = 1e-12;
    return result;
  }
};

SceneOptions small_scene() {
  SceneOptions options;
  options.poses = 10;
  options.fixed = 3;
  options.points = 400;
  return options;
}

double worst_pose(const Scene& scene) {
  double worst = 0;
  for (std::size_t i = 0; i < scene.T_c_w.size(); ++i) {
    worst = std::max(worst, minus(scene.problem.T_c_w[i], scene.T_c_w[i]).norm());
  }
  return worst;
}

/// Observations at double precision in effect: noise-free scenes keep what float rounding left, so
/// the truth is moved to agree with the rounded observations only to about 1e-5 px.
TEST_P(AdjustBundle, RecoversAPerturbedNoiseFreeScene) {
  Scene scene = make_scene(small_scene());
  perturb(scene, 0.005, 0.05, 0.1);
  const auto summary = adjust_bundle(scene.problem, options());
  EXPECT_LT(worst_pose(scene), 1e-6);
  EXPECT_EQ(std::count(summary.outlier.begin(), summary.outlier.end(), 1), 0);
  EXPECT_LT(summary.final_cost, 1e-4);
  EXPECT_GT(summary.initial_cost, 100);
}

TEST_P(AdjustBundle, FixedPosesDoNotMove) {
  Scene scene = make_scene(small_scene());
  perturb(scene, 0.005, 0.05, 0.1);
  adjust_bundle(scene.problem, options());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(scene.problem.T_c_w[i].rotation.coeffs(), scene.T_c_w[i].rotation.coeffs());
    EXPECT_EQ(scene.problem.T_c_w[i].translation, scene.T_c_w[i].translation);
  }
}

TEST_P(AdjustBundle, CostOfANoisySceneIsHalfItsDegreesOfFreedom) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1.0;
  Scene scene = make_scene(scene_options);
  perturb(scene, 0.002, 0.03, 0.05);
  BundleOptions bundle = options();
  bundle.chi2_mono = bundle.chi2_stereo = 1e6;
  const auto summary = adjust_bundle(scene.problem, bundle);
  double freedom = -6.0 * 7 - 3.0 * static_cast<double>(scene.points.size());
  for (const auto& o : scene.problem.observations) freedom += std::isnan(o.u_right) ? 2 : 3;
  // 2*cost is chi-square distributed: standard deviation sqrt(2*freedom).
  EXPECT_NEAR(2 * summary.final_cost, freedom, 4 * std::sqrt(2 * freedom));
}

/// The point of observation number i.
std::size_t point_of(const BundleProblem& problem, std::size_t i) {
  const auto after =
      std::upper_bound(problem.first.begin(), problem.first.end(), static_cast<std::int32_t>(i));
  return static_cast<std::size_t>(after - problem.first.begin()) - 1;
}

/// A scene whose noise of v is a half, and of the disparity a third, of that of u.
Scene scene_of_ratio(std::uint64_t seed) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1.0;
  scene_options.seed = seed;
  Scene scene = make_scene(scene_options);
  scene.problem.ratio = {4, 9};
  for (std::size_t i = 0; i < scene.problem.observations.size(); ++i) {
    auto& o = scene.problem.observations[i];
    const Eigen::Vector3d exact = scene.problem.camera.project_stereo(
        scene.T_c_w[o.pose] * scene.points[point_of(scene.problem, i)]);
    o.v = static_cast<float>(exact.y() + (o.v - exact.y()) / 2);
    const double disparity = exact.x() - exact.z();
    o.u_right = static_cast<float>(o.u - disparity - ((o.u - o.u_right) - disparity) / 3);
  }
  perturb(scene, 0.002, 0.03, 0.05);
  return scene;
}

/// Of the poses, along the direction of travel, which disparities determine most.
double squared_errors_ahead(const Scene& scene) {
  double sum = 0;
  for (std::size_t k = 0; k < scene.T_c_w.size(); ++k) {
    sum += std::pow(minus(scene.problem.T_c_w[k], scene.T_c_w[k])[5], 2);
  }
  return sum;
}

TEST_P(AdjustBundle, RowsAndDisparitiesWeighByTheirRatio) {
  BundleOptions bundle = options();
  bundle.chi2_mono = bundle.chi2_stereo = 1e6;
  bundle.function_tolerance = 1e-9;
  double by_ratio = 0, alike = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    Scene scene = scene_of_ratio(seed);
    Scene same = scene;
    const auto summary = adjust_bundle(scene.problem, bundle);
    double freedom = -6.0 * 7 - 3.0 * static_cast<double>(scene.points.size());
    for (const auto& o : scene.problem.observations) freedom += std::isnan(o.u_right) ? 2 : 3;
    EXPECT_NEAR(2 * summary.final_cost, freedom, 4 * std::sqrt(2 * freedom)) << seed;
    same.problem.ratio = {};
    adjust_bundle(same.problem, bundle);
    by_ratio += squared_errors_ahead(scene);
    alike += squared_errors_ahead(same);
  }
  // Over 1000 seeds it is 0.66.
  EXPECT_LT(by_ratio, 0.85 * alike) << "true weights give better poses";
}

TEST_P(AdjustBundle, SetsOutliersAside) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 0.2;
  scene_options.mono_share = 0;
  Scene scene = make_scene(scene_options);
  std::vector<std::size_t> wrong;
  const std::vector<std::int32_t>& first = scene.problem.first;
  for (std::size_t i = 0; i < scene.problem.observations.size(); i += 37) {
    // Of two observations that disagree nobody can say which is wrong.
    const std::size_t point = point_of(scene.problem, i);
    if (first[point + 1] - first[point] < 4) continue;
    scene.problem.observations[i].v += 30;
    wrong.push_back(i);
  }
  perturb(scene, 0.001, 0.02, 0.02);
  const auto summary = adjust_bundle(scene.problem, options());
  for (const std::size_t i : wrong) EXPECT_EQ(summary.outlier[i], 1) << i;
  const auto flagged = std::count(summary.outlier.begin(), summary.outlier.end(), 1);
  EXPECT_LT(flagged, static_cast<std::ptrdiff_t>(wrong.size() * 2));
  EXPECT_LT(worst_pose(scene), 0.01);
}

TEST_P(AdjustBundle, AWeightScalesTheInformationOfAPoint) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1;
  Scene weighted = make_scene(scene_options);
  perturb(weighted, 0.002, 0.02, 0.02);
  Scene blurred = weighted;
  weighted.problem.weights.assign(weighted.points.size(), 1);
  for (std::size_t k = 0; k < weighted.points.size(); k += 3) weighted.problem.weights[k] = 0.25f;
  const auto levels = static_cast<std::uint32_t>(blurred.problem.inv_sigma.size());
  for (std::uint32_t k = 0; k < levels; ++k) {
    blurred.problem.inv_sigma.push_back(0.5f * blurred.problem.inv_sigma[k]);
  }
  for (std::size_t i = 0; i < blurred.problem.observations.size(); ++i) {
    auto& o = blurred.problem.observations[i];
    if (point_of(blurred.problem, i) % 3 == 0) o.noise = (o.noise + levels) & 0xffu;
  }
  BundleOptions plain = options();
  plain.robust = false;
  plain.refine_iterations = 0;
  const auto a = adjust_bundle(weighted.problem, plain);
  const auto b = adjust_bundle(blurred.problem, plain);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-9 * b.final_cost);
  for (std::size_t k = 0; k < weighted.T_c_w.size(); ++k) {
    EXPECT_LT(minus(weighted.problem.T_c_w[k], blurred.problem.T_c_w[k]).norm(), 1e-6) << k;
  }
  // The bounds of outliers know of no weight: those of the blurred points are wider.
  EXPECT_GT(std::count(a.outlier.begin(), a.outlier.end(), 1),
            std::count(b.outlier.begin(), b.outlier.end(), 1));
}

TEST_P(AdjustBundle, HoldsOnePoseWhenNoneIsFixed) {
  SceneOptions scene_options = small_scene();
  scene_options.fixed = 0;
  Scene scene = make_scene(scene_options);
  perturb(scene, 0.001, 0.02, 0.05);
  const Rigid3 held = scene.problem.T_c_w[0];
  adjust_bundle(scene.problem, options());
  EXPECT_EQ(scene.problem.T_c_w[0].translation, held.translation);
  for (std::size_t i = 1; i < scene.T_c_w.size(); ++i) {  // true relative to the held pose
    const Rigid3 estimated = scene.problem.T_c_w[i] * scene.problem.T_c_w[0].inverse();
    const Rigid3 expected = scene.T_c_w[i] * scene.T_c_w[0].inverse();
    EXPECT_LT(minus(estimated, expected).norm(), 1e-5) << i;
  }
}

TEST_P(AdjustBundle, APoseThatTooLittleHoldsStaysAndMovesNothing) {
  Scene scene = make_scene(small_scene());
  // Of pose 5 four observations stay, all of wrong landmarks; of pose 7 twelve, nine of them wrong.
  BundleProblem all = scene.problem;
  scene.problem.points.clear();
  scene.problem.observations.clear();
  scene.problem.first = {0};
  int of_5 = 0;
  int of_7 = 0;
  for (std::size_t point = 0; point < all.points.size(); ++point) {
    scene.problem.add_point(all.points[point]);
    for (auto i = all.first[point]; i < all.first[point + 1]; ++i) {
      BundleProblem::Observation& o = all.observations[static_cast<std::size_t>(i)];
      if (o.pose == 5 && ++of_5 > 4) continue;
      if (o.pose == 7 && ++of_7 > 12) continue;
      if (o.pose == 5 || (o.pose == 7 && of_7 <= 9)) o.u += 40.0f * static_cast<float>(of_5 + of_7);
      scene.problem.add_observation(o);
    }
  }
  perturb(scene, 0.001, 0.02, 0.02);
  const std::vector<Rigid3> before = scene.problem.T_c_w;
  const auto summary = adjust_bundle(scene.problem, options());
  for (std::size_t k = 0; k < before.size(); ++k) {
    const bool unconstrained = k == 5 || k == 7;
    EXPECT_EQ(summary.unconstrained[k] != 0, unconstrained) << k;
    if (unconstrained) {
      EXPECT_EQ(minus(scene.problem.T_c_w[k], before[k]).norm(), 0) << k;
    } else {
      EXPECT_LT(minus(scene.problem.T_c_w[k], scene.T_c_w[k]).norm(), 1e-5) << k;
    }
  }
}

TEST_P(AdjustBundle, NonFiniteInputIsOutlierAndNeverSpreads) {
  Scene scene = make_scene(small_scene());
  perturb(scene, 0.001, 0.02, 0.05);
  auto& observations = scene.problem.observations;
  observations[0].u = kNoRight;
  observations[5].v = std::numeric_limits<float>::infinity();
  observations[9].noise = static_cast<std::uint8_t>(scene.problem.inv_sigma.size());
  scene.problem.inv_sigma.push_back(kNoRight);
  observations[12].u_right = -std::numeric_limits<float>::infinity();
  const std::size_t bad_point = point_of(scene.problem, 40);
  scene.problem.points[bad_point].y() = std::numeric_limits<double>::quiet_NaN();
  const auto summary = adjust_bundle(scene.problem, options());
  for (const std::size_t i : {0, 5, 9, 12, 40}) EXPECT_EQ(summary.outlier[i], 1) << i;
  EXPECT_LT(worst_pose(scene), 1e-5);
  EXPECT_TRUE(std::isfinite(summary.final_cost));
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    if (i != bad_point) {
      EXPECT_TRUE(scene.problem.points[i].allFinite()) << i;
    }
  }
}

TEST_P(AdjustBundle, NonFinitePoseTakesNoPart) {
  Scene scene = make_scene(small_scene());
  scene.problem.T_c_w[4].translation.z() = std::numeric_limits<double>::infinity();
  const auto summary = adjust_bundle(scene.problem, options());
  for (std::size_t i = 0; i < summary.outlier.size(); ++i) {
    EXPECT_EQ(summary.outlier[i], scene.problem.observations[i].pose == 4 ? 1 : 0);
  }
}

TEST_P(AdjustBundle, PointBehindTheCameraIsAnOutlierAndHarmsNobody) {
  Scene scene = make_scene(small_scene());
  perturb(scene, 0.001, 0.02, 0.05);
  scene.problem.points[7] = scene.T_c_w[0].inverse() * Eigen::Vector3d(1, 1, -20);
  const auto summary = adjust_bundle(scene.problem, options());
  for (std::size_t i = 0; i < summary.outlier.size(); ++i) {
    if (point_of(scene.problem, i) == 7) {
      EXPECT_EQ(summary.outlier[i], 1);
    }
  }
  EXPECT_LT(worst_pose(scene), 1e-5);
}

TEST_P(AdjustBundle, EmptyProblems) {
  BundleProblem problem;
  problem.camera = kitti_camera();
  EXPECT_EQ(adjust_bundle(problem, options()).iterations, 0);
  problem.T_c_w.resize(2);
  problem.pose_fixed.assign(2, 0);
  for (int i = 0; i < 3; ++i) problem.add_point({0, 0, 5});
  const auto summary = adjust_bundle(problem, options());
  EXPECT_TRUE(summary.outlier.empty());
  EXPECT_EQ(problem.points[1], Eigen::Vector3d(0, 0, 5));
}

TEST_P(AdjustBundle, OnlyFixedPosesTriangulatesThePoints) {
  SceneOptions scene_options = small_scene();
  scene_options.fixed = scene_options.poses;
  Scene scene = make_scene(scene_options);
  perturb(scene, 0, 0, 0.2);
  adjust_bundle(scene.problem, options());
  for (std::size_t i = 0; i < scene.points.size(); ++i) {
    const double depth = scene.points[i].norm();
    EXPECT_LT((scene.problem.points[i] - scene.points[i]).norm(), 1e-4 * depth * depth) << i;
  }
}

TEST_P(AdjustBundle, StopFlagLeavesAValidState) {
  Scene scene = make_scene(small_scene());
  perturb(scene, 0.005, 0.05, 0.1);
  const std::atomic<bool> stop{true};
  BundleOptions bundle = options();
  bundle.stop = &stop;
  const auto summary = adjust_bundle(scene.problem, bundle);
  EXPECT_TRUE(summary.stopped);
  EXPECT_LE(summary.iterations, 1);
  EXPECT_EQ(summary.outlier.size(), scene.problem.observations.size());
  for (const Rigid3& T : scene.problem.T_c_w) EXPECT_TRUE(T.is_finite());
}

TEST_P(AdjustBundle, SameInputSameBytes) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1;
  Scene first = make_scene(scene_options);
  perturb(first, 0.001, 0.02, 0.05);
  Scene second = first;
  adjust_bundle(first.problem, options());
  adjust_bundle(second.problem, options());
  for (std::size_t i = 0; i < first.points.size(); ++i) {
    EXPECT_EQ(first.problem.points[i], second.problem.points[i]);
  }
}

TEST_P(AdjustBundle, PointSeenTwiceFromOnePose) {
  Scene scene = make_scene(small_scene());
  const BundleProblem once = scene.problem;
  scene.problem.points.clear();
  scene.problem.observations.clear();
  scene.problem.first = {0};
  for (std::size_t point = 0; point < once.points.size(); ++point) {
    scene.problem.add_point(once.points[point]);
    for (auto i = once.first[point]; i < once.first[point + 1]; ++i) {
      const BundleProblem::Observation& o = once.observations[static_cast<std::size_t>(i)];
      scene.problem.add_observation(o);
      if (i % 3 == 0) scene.problem.add_observation(o);
    }
  }
  perturb(scene, 0.002, 0.03, 0.05);
  adjust_bundle(scene.problem, options());
  EXPECT_LT(worst_pose(scene), 1e-6);
}

INSTANTIATE_TEST_SUITE_P(Solvers, AdjustBundle,
                         ::testing::Values(Solver{"schur", BundleSolver::kSchur, nullptr},
                                           Solver{"sparse", BundleSolver::kSparseSchur, nullptr},
                                           Solver{"ceres", BundleSolver::kAuto,
                                                  solve_bundle_ceres}),
                         [](const auto& parameter) { return parameter.param.name; });

TEST(AdjustBundleSolvers, ReachTheSameMinimum) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1;
  for (const bool robust : {false, true}) {
    Scene schur = make_scene(scene_options);
    perturb(schur, 0.002, 0.03, 0.05);
    for (std::size_t i = 0; i < schur.problem.observations.size(); i += 50) {
      schur.problem.observations[i].v += 12;
    }
    Scene ceres = schur;
    BundleOptions bundle;
    bundle.robust = robust;
    bundle.iterations = 100;
    bundle.refine_iterations = 0;
    bundle.function_tolerance = 1e-14;
    bundle.solver = BundleSolver::kSchur;
    bundle.round_solver = nullptr;
    const auto a = adjust_bundle(schur.problem, bundle);
    bundle.round_solver = solve_bundle_ceres;
    const auto b = adjust_bundle(ceres.problem, bundle);
    EXPECT_NEAR(a.initial_cost, b.initial_cost, 1e-9 * b.initial_cost);
    EXPECT_NEAR(a.final_cost, b.final_cost, 1e-8 * b.final_cost);
    EXPECT_EQ(a.outlier, b.outlier);
    for (std::size_t i = 0; i < schur.T_c_w.size(); ++i) {
      EXPECT_LT(minus(schur.problem.T_c_w[i], ceres.problem.T_c_w[i]).norm(), 2e-5) << i;
    }
  }
}

/// Expected motions that contradict the observations, between free poses and from a fixed one.
TEST(AdjustBundleSolvers, ExpectedMotionsLeadToTheSameMinimum) {
  SceneOptions scene_options = small_scene();
  scene_options.noise = 1;
  Scene scene = make_scene(scene_options);
  const auto expect = [&](std::uint32_t a, std::uint32_t b) {
    Rigid3 T_a_b = scene.T_c_w[a] * scene.T_c_w[b].inverse();
    T_a_b.translation += Eigen::Vector3d(0.01, -0.02, 0.03);
    scene.problem.motions.push_back({a, b, T_a_b, 0.005, 0.002});
  };
  expect(5, 4);
  expect(6, 7);
  expect(9, 3);
  expect(8, 1);  // a fixed pose
  perturb(scene, 0.002, 0.03, 0.05);
  const auto solved = [&](BundleSolver solver, BundleRoundSolver reference) {
    BundleProblem problem = scene.problem;
    BundleOptions bundle;
    bundle.iterations = 100;
    bundle.refine_iterations = 0;
    bundle.function_tolerance = 1e-14;
    bundle.solver = solver;
    bundle.round_solver = reference;
    const BundleSummary summary = adjust_bundle(problem, bundle);
    return std::pair{summary, problem.T_c_w};
  };
  const auto [reference, poses] = solved(BundleSolver::kAuto, solve_bundle_ceres);
  for (const BundleSolver solver : {BundleSolver::kSchur, BundleSolver::kSparseSchur}) {
    const auto [own, own_poses] = solved(solver, nullptr);
    EXPECT_NEAR(own.initial_cost, reference.initial_cost, 1e-9 * reference.initial_cost);
    EXPECT_NEAR(own.final_cost, reference.final_cost, 1e-6 * reference.final_cost);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      EXPECT_LT(minus(own_poses[i], poses[i]).norm(), 1e-4) << i;
    }
  }
  scene.problem.motions.clear();
  const auto [without, free_poses] = solved(BundleSolver::kSchur, nullptr);
  EXPECT_GT(minus(free_poses[6], poses[6]).norm(), 1e-3) << "they make a difference";
}

/// Largest difference of two poses of one frame.
double largest_difference(const std::vector<Rigid3>& a, const std::vector<Rigid3>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    largest = std::max(largest, minus(a[i], b[i]).norm());
  }
  return largest;
}

/// Where a whole map ends up: own solver and reference.
void expect_same_minimum(const Scene& scene, bool robust) {
  BundleOptions bundle;
  bundle.robust = robust;
  bundle.iterations = 200;
  bundle.refine_iterations = 0;
  bundle.function_tolerance = 1e-16;
  BundleProblem own = scene.problem;
  bundle.solver = BundleSolver::kSparseSchur;
  const auto a = adjust_bundle(own, bundle);
  BundleProblem reference = scene.problem;
  bundle.round_solver = solve_bundle_ceres;
  const auto b = adjust_bundle(reference, bundle);
  EXPECT_NEAR(a.initial_cost, b.initial_cost, 1e-9 * b.initial_cost);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-6 * b.final_cost);
  EXPECT_LT(a.final_cost, 0.9 * a.initial_cost);
  EXPECT_EQ(a.outlier, b.outlier);
  EXPECT_LT(largest_difference(own.T_c_w, reference.T_c_w), 1e-6);
}

TEST(FullBundle, ReachesTheMinimumOfTheReferenceOnAStreetWithALoop) {
  Scene scene = make_loop_scene(60, 2500, 0.7);
  perturb(scene, 0.0005, 0.02, 0.02);
  expect_same_minimum(scene, false);
}

TEST(FullBundle, ReachesTheMinimumOfTheReferenceInAHall) {
  Scene scene = make_hall_scene(40, 600, 0.7);
  perturb(scene, 0.0005, 0.02, 0.02);
  for (std::size_t i = 0; i < scene.problem.observations.size(); i += 50) {
    scene.problem.observations[i].v += 12;
  }
  expect_same_minimum(scene, true);
}

TEST(FullBundle, SparseAndDenseSystemsTakeTheSameSteps) {
  Scene scene = make_loop_scene(60, 1500, 0);  // exact: no point needs a step of its own
  perturb(scene, 1e-4, 1e-3, 1e-3);
  BundleOptions bundle;
  bundle.refine_iterations = 0;
  BundleProblem sparse = scene.problem;
  bundle.solver = BundleSolver::kSparseSchur;
  bundle.iterations = 20;
  bundle.function_tolerance = 1e-12;
  adjust_bundle(sparse, bundle);
  BundleProblem dense = scene.problem;
  bundle.solver = BundleSolver::kSchur;
  adjust_bundle(dense, bundle);
  for (std::size_t i = 0; i < dense.T_c_w.size(); ++i) {
    EXPECT_LT(minus(sparse.T_c_w[i], dense.T_c_w[i]).norm(), 1e-5) << i;
    EXPECT_LT(minus(sparse.T_c_w[i], scene.T_c_w[i]).norm(), 1e-4) << i;
  }
}

TEST(FullBundle, WithPointIterationsADenseSystemTakesTheStepsOfASparseOne) {
  Scene scene = make_loop_scene(60, 1500, 0.7);
  perturb(scene, 0.0005, 0.02, 0.02);
  const auto poses_after = [&](BundleSolver solver, bool iterate_points) {
    BundleProblem problem = scene.problem;
    BundleOptions bundle;
    bundle.refine_iterations = 0;
    bundle.iterations = 3;
    bundle.solver = solver;
    bundle.iterate_points = iterate_points;
    adjust_bundle(problem, bundle);
    return problem.T_c_w;
  };
  const std::vector<Rigid3> sparse = poses_after(BundleSolver::kSparseSchur, false);
  EXPECT_LT(largest_difference(poses_after(BundleSolver::kSchur, true), sparse), 1e-9);
  EXPECT_GT(largest_difference(poses_after(BundleSolver::kSchur, false), sparse), 1e-6);
}

TEST(FullBundle, ExpectedMotionsJoinPosesThatShareNoPoint) {
  Scene scene = make_loop_scene(60, 1500, 0);
  const auto expect = [&](std::uint32_t a, std::uint32_t b) {
    scene.problem.motions.push_back({a, b, scene.T_c_w[a] * scene.T_c_w[b].inverse(), 0.01, 0.001});
  };
  expect(10, 40);
  expect(41, 10);
  expect(20, 19);
  perturb(scene, 1e-4, 1e-3, 1e-3);
  BundleOptions bundle;
  bundle.refine_iterations = 0;
  bundle.iterations = 20;
  bundle.function_tolerance = 1e-12;
  for (const BundleSolver solver : {BundleSolver::kSchur, BundleSolver::kSparseSchur}) {
    BundleProblem problem = scene.problem;
    bundle.solver = solver;
    const BundleSummary summary = adjust_bundle(problem, bundle);
    EXPECT_LT(summary.final_cost, 1e-3);
    for (std::size_t i = 0; i < problem.T_c_w.size(); ++i) {
      EXPECT_LT(minus(problem.T_c_w[i], scene.T_c_w[i]).norm(), 1e-4) << i;
    }
  }
}

TEST(FullBundle, ManyPosesAreSolvedSparselyAndAlwaysAlike) {
  Scene scene = make_loop_scene(kDenseMaxPoses + 2, 3000, 0.7);
  perturb(scene, 0.0005, 0.02, 0.02);
  BundleOptions bundle;
  BundleProblem first = scene.problem;
  adjust_bundle(first, bundle);
  BundleProblem second = scene.problem;
  bundle.solver = BundleSolver::kSparseSchur;
  adjust_bundle(second, bundle);
  for (std::size_t i = 0; i < first.points.size(); ++i) {
    ASSERT_EQ(first.points[i], second.points[i]);
  }
}

TEST(FullBundle, StopsInTheMiddleOfAnIteration) {
  Scene scene = make_loop_scene(300, 30000, 0.7);
  perturb(scene, 0.0005, 0.02, 0.02);
  for (const int ms : {1, 20, 50}) {
    BundleProblem problem = scene.problem;
    std::atomic<bool> stop{false};
    BundleOptions bundle;
    bundle.stop = &stop;
    bundle.iterations = 100000;
    bundle.function_tolerance = 0;
    std::thread other([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(ms));
      stop = true;
    });
    const BundleSummary summary = adjust_bundle(problem, bundle);
    other.join();
    EXPECT_TRUE(summary.stopped);
    EXPECT_LE(summary.final_cost, summary.initial_cost);
    for (const Rigid3& T : problem.T_c_w) EXPECT_TRUE(T.is_finite());
    bundle.stop = nullptr;  // what it stopped at is what it says
    bundle.iterations = 0;
    bundle.refine_iterations = 0;
    EXPECT_NEAR(adjust_bundle(problem, bundle).initial_cost, summary.final_cost,
                1e-9 * summary.final_cost);
  }
}

TEST(AdjustBundleArguments, WrongOnesAreRefused) {
  Scene scene = make_scene(small_scene());
  const auto refused = [&](auto change) {
    BundleProblem wrong = scene.problem;
    change(wrong);
    EXPECT_THROW(adjust_bundle(wrong, {}), std::invalid_argument);
  };
  refused([](BundleProblem& p) { p.observations[3].pose = 400; });
  refused([](BundleProblem& p) { p.observations[3].noise = 6; });
  refused([](BundleProblem& p) { p.observations.pop_back(); });
  refused([](BundleProblem& p) { p.first.pop_back(); });
  refused([](BundleProblem& p) { p.first[3] = p.first[4] + 1; });
  refused([](BundleProblem& p) { p.first.front() = 1; });
  refused([](BundleProblem& p) { p.motions.push_back({3, 3, {}, 0.1, 0.1}); });
  refused([](BundleProblem& p) { p.motions.push_back({3, 400, {}, 0.1, 0.1}); });
  refused([](BundleProblem& p) { p.motions.push_back({3, 4, {}, 0.1, 0}); });
  scene.problem.weights.resize(3, 1);
  EXPECT_THROW(adjust_bundle(scene.problem, {}), std::invalid_argument);
  scene.problem.weights.clear();
  scene.problem.pose_fixed.pop_back();
  EXPECT_THROW(adjust_bundle(scene.problem, {}), std::invalid_argument);
}

}  // namespace
}  // namespace kys_slam::test
