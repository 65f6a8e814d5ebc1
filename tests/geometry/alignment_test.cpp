// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <stdexcept>

#include "geometry/absolute_orientation.h"
#include "geometry/stereo_alignment.h"
#include "optimization/synthetic_scene.h"

namespace kys_slam::test {
namespace {

const Rigid3 kTruth(so3_exp({0.05, -0.6, 0.1}), {2, 0.3, -1.5});

StereoPixel noisy_pixel(const Eigen::Vector3d& p_c, double noise, Random& random) {
  const Eigen::Vector3d uvr = kitti_camera().project_stereo(p_c);
  StereoPixel pixel;
  pixel.u = static_cast<float>(uvr.x() + random.normal(noise));
  pixel.v = static_cast<float>(uvr.y() + random.normal(noise));
  pixel.u_right = static_cast<float>(uvr.z() + random.normal(noise));
  return pixel;
}

Eigen::Vector3d triangulated(const StereoPixel& pixel) {
  const StereoCamera camera = kitti_camera();
  return camera.back_project(pixel.u, pixel.v, camera.bf() / (pixel.u - pixel.u_right));
}

/// Matches of two stereo frames; `wrong` marks those whose b side belongs to another point.
std::vector<PointMatch> make_matches(int count, double noise, double wrong_share,
                                     std::uint64_t seed, std::vector<std::uint8_t>& wrong) {
  Random random(seed);
  std::vector<PointMatch> matches;
  wrong.clear();
  while (static_cast<int>(matches.size()) < count) {
    const Eigen::Vector3d p_a(random.uniform(-8, 8), random.uniform(-2, 2), random.uniform(6, 30));
    Eigen::Vector3d p_b = kTruth.inverse() * p_a;
    if (p_b.z() < 3) continue;
    const bool is_wrong = random.uniform(0, 1) < wrong_share;
    if (is_wrong) p_b += Eigen::Vector3d(random.uniform(2, 5), random.uniform(1, 3), 4);
    wrong.push_back(is_wrong ? 1 : 0);
    PointMatch m;
    m.pixel_a = noisy_pixel(p_a, noise, random);
    m.pixel_b = noisy_pixel(p_b, noise, random);
    m.p_a = noise > 0 ? triangulated(m.pixel_a) : p_a;
    m.p_b = noise > 0 ? triangulated(m.pixel_b) : p_b;
    matches.push_back(m);
  }
  return matches;
}

TEST(AbsoluteOrientation, RecoversTheMotion) {
  Random random(1);
  for (const int count : {3, 4, 50}) {
    std::vector<Eigen::Vector3d> a;
    std::vector<Eigen::Vector3d> b;
    for (int i = 0; i < count; ++i) {
      b.push_back(random.vector(5));
      a.push_back(kTruth * b.back());
    }
    const auto T = absolute_orientation(a, b);
    ASSERT_TRUE(T);
    EXPECT_LT(minus(*T, kTruth).norm(), 1e-12 * 100);
  }
}

TEST(AbsoluteOrientation, NeverMirrors) {
  // Points whose best orthogonal map is a reflection.
  const std::vector<Eigen::Vector3d> b{{1, 0, 0}, {0, 2, 0}, {0, 0, 3}, {-1, -1, -1}};
  std::vector<Eigen::Vector3d> a = b;
  for (auto& p : a) p.x() = -p.x();
  const auto T = absolute_orientation(a, b);
  ASSERT_TRUE(T);
  EXPECT_NEAR(T->R().determinant(), 1, 1e-12);
}

TEST(AbsoluteOrientation, ZeroWeightTakesAPointOut) {
  Random random(2);
  std::vector<Eigen::Vector3d> a;
  std::vector<Eigen::Vector3d> b;
  std::vector<double> weights(6, 1.0);
  for (int i = 0; i < 6; ++i) {
    b.push_back(random.vector(5));
    a.push_back(kTruth * b.back());
  }
  a[2] += Eigen::Vector3d(10, 0, 0);
  weights[2] = 0;
  EXPECT_LT(minus(*absolute_orientation(a, b, weights), kTruth).norm(), 1e-10);
}

TEST(AbsoluteOrientation, DegenerateInputGivesNothing) {
  const std::vector<Eigen::Vector3d> line{{0, 0, 1}, {0, 0, 2}, {0, 0, 3}};
  EXPECT_FALSE(absolute_orientation(line, line));
  const std::vector<Eigen::Vector3d> two{{0, 0, 1}, {1, 0, 2}};
  EXPECT_FALSE(absolute_orientation(two, two));
  std::vector<Eigen::Vector3d> bad{{0, 0, 1}, {1, 0, 2}, {0, 1, 1}};
  bad[1].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(absolute_orientation(bad, bad));
  EXPECT_THROW(absolute_orientation(two, line), std::invalid_argument);
}

TEST(AlignSe3, FindsTheMotionAmongHalfOutliers) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<std::uint8_t> wrong;
    const auto matches = make_matches(100, 0, 0.5, seed, wrong);
    RansacOptions options;
    options.seed = seed;
    const auto result = align_se3_ransac(kitti_camera(), matches, options);
    ASSERT_TRUE(result.success) << seed;
    // m and rad: the fit stops where its cost hardly falls, so compilers differ.
    EXPECT_LT(minus(result.T, kTruth).norm(), 1e-5) << seed;
    for (std::size_t i = 0; i < wrong.size(); ++i) EXPECT_NE(result.inlier[i], wrong[i]) << i;
  }
}

TEST(AlignSe3, IsAccurateWithNoiseAndHalfOutliers) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    std::vector<std::uint8_t> wrong;
    const auto matches = make_matches(120, 0.5, 0.5, seed, wrong);
    const auto result = align_se3_ransac(kitti_camera(), matches, {});
    ASSERT_TRUE(result.success) << seed;
    EXPECT_LT(minus(result.T, kTruth).head<3>().norm(), 0.005) << seed;
    EXPECT_LT(minus(result.T, kTruth).tail<3>().norm(), 0.08) << seed;
    for (std::size_t i = 0; i < wrong.size(); ++i) {
      EXPECT_FALSE(wrong[i] != 0 && result.inlier[i] != 0) << i;
    }
  }
}

TEST(AlignSe3, NoMotionInNoise) {
  Random random(5);
  std::vector<std::uint8_t> wrong;
  auto matches = make_matches(60, 0.5, 0, 1, wrong);
  for (std::size_t i = 0; i < matches.size(); ++i) {  // every point with some other
    const std::size_t k = (i * 17 + 23) % matches.size();
    matches[i].p_b = triangulated(matches[k].pixel_b);
    matches[i].pixel_b = matches[k].pixel_b;
  }
  const auto result = align_se3_ransac(kitti_camera(), matches, {});
  EXPECT_FALSE(result.success);
  EXPECT_EQ(result.inliers, 0);
  EXPECT_EQ(minus(result.T, Rigid3()).norm(), 0);
}

TEST(AlignSe3, SameSeedSameAnswer) {
  std::vector<std::uint8_t> wrong;
  const auto matches = make_matches(80, 0.7, 0.6, 3, wrong);
  RansacOptions options;
  options.seed = 42;
  const auto a = align_se3_ransac(kitti_camera(), matches, options);
  const auto b = align_se3_ransac(kitti_camera(), matches, options);
  EXPECT_EQ(a.T.rotation.coeffs(), b.T.rotation.coeffs());
  EXPECT_EQ(a.T.translation, b.T.translation);
  EXPECT_EQ(a.inlier, b.inlier);
}

TEST(AlignSe3, NonFiniteMatchesAreIgnored) {
  std::vector<std::uint8_t> wrong;
  auto matches = make_matches(40, 0, 0, 3, wrong);
  matches[0].p_a.x() = std::numeric_limits<double>::quiet_NaN();
  matches[1].pixel_b.v = std::numeric_limits<float>::infinity();
  matches[2].pixel_a.inv_sigma = 0;
  const auto result = align_se3_ransac(kitti_camera(), matches, {});
  EXPECT_TRUE(result.success);
  EXPECT_EQ(result.inliers, 37);
  EXPECT_LT(minus(result.T, kTruth).norm(), 1e-6);
}

TEST(AlignSe3, TooFewMatches) {
  std::vector<std::uint8_t> wrong;
  for (const int count : {0, 1, 2}) {
    const auto matches = make_matches(count, 0, 0, 3, wrong);
    const auto result = align_se3_ransac(kitti_camera(), matches, {});
    EXPECT_FALSE(result.success);
    EXPECT_EQ(result.inlier.size(), matches.size());
  }
}

}  // namespace
}  // namespace kys_slam::test
