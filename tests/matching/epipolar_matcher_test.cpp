// SPDX-License-Identifier: BSD-3-Clause
#include "matching/epipolar_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "support/map_builder.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;

struct Score {
  int common = 0;  // points seen in both frames on neighbouring octaves
  int right = 0;
  int wrong = 0;
};

class EpipolarMatcher : public ::testing::Test {
 protected:
  /// The same view, its descriptors taken from a palette: look-alikes that geometry must tell
  /// apart.
  testing::SeenFeatures look(const FeatureWorld& world, int index, const Rigid3& T_w_c,
                             std::size_t palette, bool stereo) {
    testing::SeenFeatures seen = testing::see(world, index, T_w_c, stereo);
    FeatureSet set{{seen.features->keypoints().begin(), seen.features->keypoints().end()}, {}};
    std::vector<float> u_right;
    for (std::size_t i = 0; i < seen.points.size(); ++i) {
      set.descriptors.push_back(world.points()[seen.points[i] % palette].descriptor);
      u_right.push_back(seen.features->u_right(i));
    }
    seen.features = std::make_shared<const FrameFeatures>(
        camera_, std::move(set), std::move(u_right), std::vector<kys::Prior>{});
    return seen;
  }

  Score run(const Rigid3& T_w_a, const Rigid3& T_w_b, std::size_t palette, bool stereo) {
    FeatureWorld::Options options;
    options.pixel_noise = 0.4;
    const FeatureWorld world(camera_, options);
    const auto a = look(world, 0, T_w_a, palette, stereo);
    const auto b = look(world, 1, T_w_b, palette, stereo);
    const std::vector<std::uint8_t> free_a(a.features->size(), 1);
    const std::vector<std::uint8_t> free_b(b.features->size(), 1);
    const auto pairs = match_epipolar(camera_, scales_, *a.features, free_a, *b.features, free_b,
                                      T_w_b.inverse() * T_w_a, {}, model_, statistics_);
    Score score;
    for (std::size_t i = 0; i < a.points.size(); ++i) {
      const auto at = std::find(b.points.begin(), b.points.end(), a.points[i]);
      if (at == b.points.end()) continue;
      const auto j = static_cast<std::size_t>(at - b.points.begin());
      score.common += std::abs(static_cast<int>(a.features->keypoint(i).octave) -
                               static_cast<int>(b.features->keypoint(j).octave)) <= 1;
    }
    std::set<std::uint32_t> used;
    for (const FeaturePair& pair : pairs) {
      EXPECT_TRUE(used.insert(pair.b).second) << "feature " << pair.b << " is matched twice";
      ++(a.points[pair.a] == b.points[pair.b] ? score.right : score.wrong);
    }
    return score;
  }

  StereoCamera camera_ = testing::kitti_camera();
  ScaleLevels scales_{1.2, 8};
  kys::DistanceModel model_;
  kys::Statistics statistics_;
};

const Rigid3 kHere;
const Rigid3 kAhead(so3_exp({0.01, 0.03, 0}), {0.1, 0.05, 1.2});
const Rigid3 kBeside(so3_exp({0, -0.02, 0.01}), {1.0, 0.1, 0.1});

TEST_F(EpipolarMatcher, FindsDistinctPointsAlongTheirLines) {
  for (const Rigid3& T_w_b : {kAhead, kBeside}) {
    const Score mono = run(kHere, T_w_b, 1000000, false);
    EXPECT_GT(mono.common, 200);
    EXPECT_EQ(mono.wrong, 0);
    EXPECT_GT(mono.right, 0.85 * mono.common);
    const Score stereo = run(kHere, T_w_b, 1000000, true);
    EXPECT_EQ(stereo.wrong, 0);
    EXPECT_GT(stereo.right, 0.85 * stereo.common);
  }
}

TEST_F(EpipolarMatcher, DepthTellsLookAlikesApart) {
  // Every descriptor belongs to some two hundred of the points in view.
  for (const Rigid3& T_w_b : {kAhead, kBeside}) {
    const Score mono = run(kHere, T_w_b, 7, false);
    const Score stereo = run(kHere, T_w_b, 7, true);
    EXPECT_GT(stereo.right, 0.9 * stereo.common);
    EXPECT_GT(stereo.right, 1.2 * mono.right) << "without depth whole lines are searched";
    EXPECT_LT(stereo.wrong, 0.02 * stereo.right);
  }
}

TEST_F(EpipolarMatcher, FeaturesThatHaveLandmarksAreLeftAlone) {
  const FeatureWorld world(camera_, {});
  const auto a = testing::see(world, 0, kHere);
  const auto b = testing::see(world, 1, kBeside);
  std::vector<std::uint8_t> free_a(a.features->size(), 1);
  std::vector<std::uint8_t> free_b(b.features->size(), 1);
  for (std::size_t i = 0; i < free_a.size(); i += 2) free_a[i] = 0;
  for (std::size_t i = 0; i < free_b.size(); i += 3) free_b[i] = 0;
  const auto pairs = match_epipolar(camera_, scales_, *a.features, free_a, *b.features, free_b,
                                    kBeside.inverse() * kHere, {}, model_, statistics_);
  EXPECT_GT(pairs.size(), 50u);
  for (const FeaturePair& pair : pairs) {
    EXPECT_EQ(free_a[pair.a], 1);
    EXPECT_EQ(free_b[pair.b], 1);
  }
  EXPECT_TRUE(std::is_sorted(pairs.begin(), pairs.end(),
                             [](const FeaturePair& x, const FeaturePair& y) { return x.a < y.a; }));
}

TEST_F(EpipolarMatcher, APointOffItsLineIsNotMatched) {
  const FeatureWorld world(camera_, {});
  const auto a = testing::see(world, 0, kHere);
  const auto b = testing::see(world, 1, kBeside);
  const std::vector<std::uint8_t> free_a(a.features->size(), 1);
  const std::vector<std::uint8_t> free_b(b.features->size(), 1);
  // A motion that is wrong by 4 degrees of roll: lines miss their points by many pixels away from
  // the image's centre.
  const Rigid3 wrong =
      Rigid3(so3_exp({0, 0, 0.07}), Eigen::Vector3d::Zero()) * (kBeside.inverse() * kHere);
  const auto count = [&](const Rigid3& T_b_a) {
    return match_epipolar(camera_, scales_, *a.features, free_a, *b.features, free_b, T_b_a, {},
                          model_, statistics_)
        .size();
  };
  EXPECT_LT(count(wrong), 0.25 * static_cast<double>(count(kBeside.inverse() * kHere)));
}

}  // namespace
}  // namespace kys_slam
