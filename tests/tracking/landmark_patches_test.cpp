// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/landmark_patches.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "support/draw_image.h"
#include "support/map_builder.h"

namespace kys_slam {
namespace {

const StereoCamera kCamera{200, 150, 180, 170, 101.3, 73.8, 0.5};
const ScaleLevels kScales(1.2, 4);
constexpr double kDepth = 8;  // m, of the wall

/// Grey levels of a wall, by m.
double wall(double x, double y) {
  return 128 + 30 * std::sin(14 * x + 8 * y) + 25 * std::sin(19 * x - 12 * y + 1) +
         20 * std::sin(7 * x + 19 * y + 2);
}

/// The wall as a camera sees it.
ImagePyramid look(const Rigid3& T_w_c) {
  const GrayImage image =
      testing::draw_image(kCamera.width, kCamera.height, [&](double u, double v) {
        const Eigen::Vector3d ray = T_w_c.rotation * kCamera.back_project(u, v, 1);
        const Eigen::Vector3d at = T_w_c.t() + ray * ((kDepth - T_w_c.t().z()) / ray.z());
        return wall(at.x(), at.y());
      });
  ImagePyramid pyramid;
  PyramidBuilder().build(image, 1.2, 4, pyramid);
  return pyramid;
}

FrameFeatures features_at(const std::vector<Eigen::Vector2d>& pixels, double disparity,
                          int octave) {
  FeatureSet set;
  std::vector<float> u_right;
  for (const Eigen::Vector2d& p : pixels) {
    Keypoint k;
    k.x = static_cast<float>(p.x());
    k.y = static_cast<float>(p.y());
    k.octave = static_cast<std::uint8_t>(octave);
    set.keypoints.push_back(k);
    u_right.push_back(k.x - static_cast<float>(disparity));
  }
  set.descriptors.resize(pixels.size());
  return {kCamera, std::move(set), std::move(u_right), {}};
}

/// Points of the wall, a keyframe that saw them, and a camera that has moved on since.
class LandmarkPatchesTest : public ::testing::Test {
 protected:
  LandmarkPatchesTest() {
    for (int i = 0; i < 12; ++i) {
      points_.push_back({-1.2 + 0.75 * (i % 4), -0.8 + 0.7 * (i / 4), kDepth});
      landmarks_.push_back({static_cast<std::uint32_t>(2 * i)});
    }
    KeyFrameView view;
    view.T_c_w = Rigid3();
    replica_.put(KeyFrameId{0}, view);
    for (std::size_t i = 0; i < points_.size(); ++i) {
      LandmarkView landmark;
      landmark.p_w = points_[i];
      replica_.put(landmarks_[i], landmark);
    }
    const FrameFeatures seen = features_at(project(Rigid3()), kCamera.bf() / kDepth, 0);
    patches_.keep(KeyFrameId{0}, landmarks_, look(Rigid3()), seen);
  }

  [[nodiscard]] std::vector<Eigen::Vector2d> project(const Rigid3& T_w_c) const {
    std::vector<Eigen::Vector2d> pixels;
    for (const Eigen::Vector3d& p : points_) pixels.push_back(kCamera.project(T_w_c.inverse() * p));
    return pixels;
  }

  /// Features that lie half a pixel beside where they should be.
  [[nodiscard]] FrameFeatures beside(const Rigid3& T_w_c, int octave) const {
    std::vector<Eigen::Vector2d> pixels = project(T_w_c);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      pixels[i] += 0.5 * Eigen::Vector2d(i % 2 == 0 ? 1 : -1, i % 3 == 0 ? 1 : -1);
    }
    return features_at(pixels, 12, octave);
  }

  std::vector<Eigen::Vector3d> points_;
  std::vector<LandmarkId> landmarks_;
  Replica replica_;
  LandmarkPatches patches_{kCamera, kScales};
};

TEST_F(LandmarkPatchesTest, KeypointsComeToTheirLandmarks) {
  // Nearer, beside, turned about all axes; the nearer camera has its corners an octave higher.
  const struct {
    Rigid3 T_w_c;
    int octave;
  } views[] = {
      {Rigid3(so3_exp(Eigen::Vector3d(0.01, -0.02, 0)), Eigen::Vector3d(0.1, 0, 0.2)), 0},
      {Rigid3(so3_exp(Eigen::Vector3d(0.02, 0.03, 0.15)), Eigen::Vector3d(0.2, -0.1, 1.1)), 1}};
  for (const auto& [T_w_c, octave] : views) {
    const FrameFeatures found = beside(T_w_c, octave);
    const auto aligned = patches_.align(replica_, T_w_c.inverse(), landmarks_, look(T_w_c), found);
    const std::vector<Eigen::Vector2d> truth = project(T_w_c);
    int count = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      EXPECT_FLOAT_EQ(aligned->depth(i), found.depth(i));
      if (!aligned->is_aligned(i)) continue;
      ++count;
      EXPECT_NEAR(aligned->keypoint(i).x, truth[i].x(), 0.08) << i << " octave " << octave;
      EXPECT_NEAR(aligned->keypoint(i).y, truth[i].y(), 0.08) << i << " octave " << octave;
    }
    EXPECT_GE(count, 10) << "octave " << octave;
  }
}

TEST_F(LandmarkPatchesTest, WhatIsUnknownStaysWhereItWasFound) {
  const FrameFeatures found = beside(Rigid3(), 0);
  std::vector<LandmarkId> others(landmarks_.size());
  others[3] = {100};  // no patch
  const auto same = patches_.align(replica_, Rigid3(), others, look(Rigid3()), found);
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_FALSE(same->is_aligned(i));
    EXPECT_EQ(same->keypoint(i), found.keypoint(i));
  }
}

TEST_F(LandmarkPatchesTest, FeaturesWithoutAPatchAreOrigins) {
  const FrameFeatures found = beside(Rigid3(), 0);
  std::vector<LandmarkId> mixed = landmarks_;
  mixed[1] = {};     // a landmark will be made of it
  mixed[2] = {100};  // seen with an image for the first time
  const auto origins = patches_.with_origins(mixed, found);
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(origins->is_aligned(i), i == 1 || i == 2) << i;
    EXPECT_EQ(origins->keypoint(i), found.keypoint(i));
  }
}

TEST_F(LandmarkPatchesTest, ChangesOfTheMapTakePatchesAway) {
  ChangeSet changes;
  changes.erased_landmarks = {landmarks_[4], landmarks_[5]};
  changes.replaced = {{landmarks_[5], landmarks_[6]}};
  patches_.apply(changes);
  const auto aligned =
      patches_.align(replica_, Rigid3(), landmarks_, look(Rigid3()), beside(Rigid3(), 0));
  EXPECT_TRUE(aligned->is_aligned(3));
  EXPECT_FALSE(aligned->is_aligned(4));
  EXPECT_FALSE(aligned->is_aligned(5));
  EXPECT_TRUE(aligned->is_aligned(6));
}

TEST_F(LandmarkPatchesTest, ACulledKeyframeIsFoundThroughItsParent) {
  const Rigid3 T_w_p(so3_exp(Eigen::Vector3d(0, 0.05, 0)), Eigen::Vector3d(0.4, 0, 0.3));
  KeyFrameView parent;
  parent.T_c_w = T_w_p.inverse();
  replica_.put(KeyFrameId{1}, parent);
  ChangeSet changes;
  changes.culled_keyframes = {{KeyFrameId{0}, KeyFrameId{1}, T_w_p}};
  replica_.apply(changes);
  const auto aligned =
      patches_.align(replica_, Rigid3(), landmarks_, look(Rigid3()), beside(Rigid3(), 0));
  const std::vector<Eigen::Vector2d> truth = project(Rigid3());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    ASSERT_TRUE(aligned->is_aligned(i)) << i;
    EXPECT_NEAR(aligned->keypoint(i).x, truth[i].x(), 0.08);
    EXPECT_NEAR(aligned->keypoint(i).y, truth[i].y(), 0.08);
  }
}

}  // namespace
}  // namespace kys_slam
