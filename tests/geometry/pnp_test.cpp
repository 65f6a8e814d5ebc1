#include "geometry/pnp.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

const Rigid3 kTruth(so3_exp({0.2, 1.1, -0.3}), {-4, 1, 7});

std::vector<PnpMatch> make_matches(int count, double noise, double mono_share, double wrong_share,
                                   std::uint64_t seed, std::vector<std::uint8_t>& wrong) {
  std::vector<PnpMatch> matches;
  Random random(seed + 1000);
  wrong.clear();
  for (const PoseObservation& o : make_frame(kTruth, count, noise, mono_share, seed)) {
    PnpMatch m{o.p_w, {o.u, o.v, o.u_right, o.inv_sigma}};
    wrong.push_back(random.uniform(0, 1) < wrong_share ? 1 : 0);
    if (wrong.back() != 0) {
      m.pixel.u += static_cast<float>(random.uniform(60, 300));
      m.pixel.v += static_cast<float>(random.uniform(60, 200));
    }
    matches.push_back(m);
  }
  return matches;
}

TEST(P3p, OneSolutionIsTheTruth) {
  Random random(1);
  for (int trial = 0; trial < 500; ++trial) {
    const Rigid3 T_c_w = plus(Rigid3(), random.increment(1, 10));
    std::array<Eigen::Vector3d, 3> points;
    std::array<Eigen::Vector3d, 3> rays;
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector3d p_c(random.uniform(-5, 5), random.uniform(-3, 3),
                                random.uniform(2, 20));
      points[i] = T_c_w.inverse() * p_c;
      rays[i] = p_c.normalized();
    }
    const auto solutions = solve_p3p(rays, points);
    ASSERT_FALSE(solutions.empty()) << trial;
    ASSERT_LE(solutions.size(), 4u);
    double best = 1e9;
    for (const Rigid3& T : solutions) {
      best = std::min(best, minus(T, T_c_w).norm());
      for (std::size_t i = 0; i < 3; ++i) {  // every solution sees the points along the rays
        EXPECT_LT((T * points[i]).normalized().cross(rays[i]).norm(), 1e-4) << trial;
      }
    }
    EXPECT_LT(best, 1e-3) << trial;
  }
}

TEST(P3p, DegeneratePointsGiveNothing) {
  const Eigen::Vector3d p(1, 2, 3);
  EXPECT_TRUE(solve_p3p({p.normalized(), p.normalized(), p.normalized()}, {p, p, p}).empty());
}

TEST(PnpRansac, FindsThePoseAmongHalfOutliers) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<std::uint8_t> wrong;
    const auto matches = make_matches(80, 0, 0.5, 0.5, seed, wrong);
    const auto result = solve_pnp_ransac(kitti_camera(), matches, {});
    ASSERT_TRUE(result.success) << seed;
    EXPECT_LT(minus(result.T, kTruth).norm(), 1e-4) << seed;
    for (std::size_t i = 0; i < wrong.size(); ++i) EXPECT_NE(result.inlier[i], wrong[i]) << i;
  }
}

TEST(PnpRansac, MonocularWithNoise) {
  std::vector<std::uint8_t> wrong;
  const auto matches = make_matches(150, 0.7, 1.0, 0.4, 2, wrong);
  const auto result = solve_pnp_ransac(kitti_camera(), matches, {});
  ASSERT_TRUE(result.success);
  EXPECT_GT(result.inliers, 70);
  EXPECT_LT(minus(result.T, kTruth).head<3>().norm(), 0.01);
  EXPECT_LT(minus(result.T, kTruth).tail<3>().norm(), 0.2);
}

TEST(PnpRansac, FailsHonestlyAndTakesAnyInput) {
  std::vector<std::uint8_t> wrong;
  auto matches = make_matches(40, 0, 0.5, 0, 2, wrong);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    matches[i].p_w = matches[(i * 7 + 5) % matches.size()].p_w;
  }
  EXPECT_FALSE(solve_pnp_ransac(kitti_camera(), matches, {}).success);
  EXPECT_FALSE(solve_pnp_ransac(kitti_camera(), {}, {}).success);
  matches.resize(5);
  for (auto& m : matches) m.p_w.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_FALSE(solve_pnp_ransac(kitti_camera(), matches, {}).success);
}

}  // namespace
}  // namespace kys_slam::test
