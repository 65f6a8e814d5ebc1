// SPDX-License-Identifier: BSD-3-Clause
#include "motion/segment_carrier.h"

#include <gtest/gtest.h>
#include <kys/kys.h>

#include <limits>
#include <memory>
#include <random>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

// A wall 20 m away, a car 10 m away before its right half, and the sky above, without a disparity.
const StereoCamera kWallCamera{640, 240, 400, 400, 320, 120, 0.5};
constexpr std::uint16_t kWallSegment = 1, kSkySegment = 2, kCarSegment = 3;  // segments
constexpr double kWallDepth = 20, kCarDepth = 10;                            // m
constexpr int kHorizon = 60;                                                 // px, sky above

class Wall : public ::testing::Test {
 protected:
  [[nodiscard]] static bool is_car(double x, double y) {  // m, at its depth
    return x > 0.5 && x < 3 && y > -0.5 && y < 1.5;
  }
  /// Features on a grid, as seen when the car has moved by `shift` and the camera is at `centre`.
  struct Seen {
    std::shared_ptr<const FrameFeatures> features;
    std::vector<std::uint16_t> truth;
  };
  [[nodiscard]] static Seen look(const Eigen::Vector3d& centre, const Eigen::Vector3d& shift,
                                 bool stereo = true) {
    Seen seen;
    FeatureSet set;
    std::vector<float> u_right;
    for (int v = 8; v < kWallCamera.height; v += 9) {
      for (int u = 8; u < kWallCamera.width; u += 11) {
        const std::uint16_t segment = segment_at(u, v, centre, shift);
        Keypoint k;
        k.x = static_cast<float>(u);
        k.y = static_cast<float>(v);
        set.keypoints.push_back(k);
        set.descriptors.emplace_back();
        const double depth =
            (segment == kCarSegment ? kCarDepth + shift.z() : kWallDepth) - centre.z();
        u_right.push_back(segment == kSkySegment || !stereo
                              ? std::numeric_limits<float>::quiet_NaN()
                              : static_cast<float>(u - kWallCamera.bf() / depth));
        seen.truth.push_back(segment);
      }
    }
    seen.features = std::make_shared<const FrameFeatures>(
        kWallCamera, std::move(set), std::move(u_right), std::vector<kys::Prior>{});
    return seen;
  }
  [[nodiscard]] static std::uint16_t segment_at(int u, int v, const Eigen::Vector3d& centre,
                                                const Eigen::Vector3d& shift) {
    const Eigen::Vector3d p =
        kWallCamera.back_project(u, v, kCarDepth + shift.z() - centre.z()) + centre - shift;
    if (is_car(p.x(), p.y())) return kCarSegment;
    return v < kHorizon ? kSkySegment : kWallSegment;
  }
  /// \param unseen px, column from which the image does not say what the car is
  [[nodiscard]] std::shared_ptr<SegmentImage> segmented(const Eigen::Vector3d& centre = {0, 0, 0},
                                                        const Eigen::Vector3d& shift = {0, 0, 0},
                                                        int unseen = kWallCamera.width) const {
    auto image = std::make_shared<SegmentImage>();
    image->map = ImageOf<std::uint16_t>(kWallCamera.width, kWallCamera.height);
    for (int y = 0; y < kWallCamera.height; ++y) {
      for (int x = 0; x < kWallCamera.width; ++x) {
        const std::uint16_t segment = segment_at(x, y, centre, shift);
        image->map.at(x, y) = segment == kCarSegment && x >= unseen ? std::uint16_t{0} : segment;
      }
    }
    for (const char* name : {"building-other-merged", "sky-other-merged", "car"}) {
      image->segments.push_back(kys::make_prior(space_.index_of(name), 0, 0, 0, false));
    }
    return image;
  }
  [[nodiscard]] SegmentCarrier carrier(const std::shared_ptr<SegmentImage>& image,
                                       std::shared_ptr<const FrameFeatures> features) const {
    std::vector<std::uint8_t> is_thing;
    for (const kys::LabelClass& c : space_.classes()) is_thing.push_back(c.thing ? 1 : 0);
    return {kWallCamera, image, image->segments, std::move(features), is_thing};
  }
  [[nodiscard]] SegmentCarrier carrier(const Eigen::Vector3d& centre = {0, 0, 0},
                                       const Eigen::Vector3d& shift = {0, 0, 0}) const {
    return carrier(segmented(centre, shift), look(centre, shift).features);
  }
  /// Of the keypoints that show `segment`, the share that gets it.
  [[nodiscard]] static double share(const Seen& seen, const std::vector<std::uint16_t>& carried,
                                    std::uint16_t segment) {
    double all = 0, right = 0;
    for (std::size_t i = 0; i < carried.size(); ++i) {
      if (seen.truth[i] != segment) continue;
      ++all;
      right += carried[i] == segment ? 1 : 0;
    }
    EXPECT_GT(all, 20);
    return right / all;
  }
  static Rigid3 from(const Eigen::Vector3d& centre) {  // T_s_now
    return {Eigen::Quaterniond::Identity(), centre};
  }

  const kys::LabelSpace space_ = kys::load_label_space("coco_panoptic_133");
  const SegmentShifts still_ = SegmentShifts(3, Eigen::Vector3d::Zero());
};

TEST_F(Wall, ItsOwnFrameHasTheSegmentsOfItsPixels) {
  EXPECT_EQ(carrier().own(), look({0, 0, 0}, {0, 0, 0}).truth);
}

TEST_F(Wall, SegmentsMoveWithTheScene) {
  const Eigen::Vector3d centre(0.6, 0, 1.5);
  const Seen now = look(centre, {0, 0, 0});
  const auto carried = carrier().carry(*now.features, from(centre), still_);
  EXPECT_GT(share(now, carried, kCarSegment), 0.95);
  // Right of the car the wall was hidden, and at the left border it was not in view.
  EXPECT_GT(share(now, carried, kWallSegment), 0.85);
}

TEST_F(Wall, ACarMovesByItself) {
  const Eigen::Vector3d centre(0, 0, 1), shift(-1, 0, 2);
  const Seen now = look(centre, shift);
  SegmentShifts shifts = still_;
  EXPECT_LT(share(now, carrier().carry(*now.features, from(centre), shifts), kCarSegment), 0.8);
  shifts[kCarSegment - 1] = shift;
  EXPECT_GT(share(now, carrier().carry(*now.features, from(centre), shifts), kCarSegment), 0.95);
}

TEST_F(Wall, KeypointsWithoutDisparityHaveTheSegmentThatCoversThem) {
  const Eigen::Vector3d centre(0, 0, 1), shift(-1, 0, 2);
  const Seen now = look(centre, shift, false);
  SegmentShifts shifts = still_;
  shifts[kCarSegment - 1] = shift;
  const auto carried = carrier().carry(*now.features, from(centre), shifts);
  EXPECT_GT(share(now, carried, kCarSegment), 0.9);
  EXPECT_GT(share(now, carried, kSkySegment), 0.9);
  EXPECT_GT(share(now, carried, kWallSegment), 0.85);
}

TEST_F(Wall, ACarGoesOnBesideItsFeaturesAndNotOntoTheWall) {
  // Columns of features on the car: 348, 359, ..., 437; from 390 on the image does not say what it
  // is.
  const Seen now = look({0, 0, 0}, {0, 0, 0});
  const auto carried = carrier(segmented({0, 0, 0}, {0, 0, 0}, 390), now.features)
                           .carry(*now.features, Rigid3(), still_);
  int gained = 0;
  for (std::size_t i = 0; i < carried.size(); ++i) {
    if (now.truth[i] != kCarSegment) {
      EXPECT_EQ(carried[i], now.truth[i]) << i;
      continue;
    }
    const float u = now.features->keypoint(i).x;
    if (u < 390) {
      EXPECT_EQ(carried[i], kCarSegment) << i;
    } else {
      gained += carried[i] == kCarSegment ? 1 : 0;
    }
  }
  EXPECT_GE(gained, 20);  // the next three columns of nine, but for their ends
}

TEST_F(Wall, AKeypointThatIsFoundAgainHasTheSegmentItWasOn) {
  const auto described = [&](float shift) {
    std::mt19937_64 random(3);
    FeatureSet set;
    const Seen seen = look({0, 0, 0}, {0, 0, 0});
    for (Keypoint k : seen.features->keypoints()) {
      k.x += shift;
      k.y += shift;
      set.keypoints.push_back(k);
      for (auto& word : set.descriptors.emplace_back().words) word = random();
    }
    std::vector<float> none(set.size(), std::numeric_limits<float>::quiet_NaN());
    return std::make_shared<const FrameFeatures>(kWallCamera, std::move(set), std::move(none),
                                                 std::vector<kys::Prior>{});
  };
  const SegmentCarrier then = carrier(segmented(), described(0));
  // The image moves by 2 px; the pose does not say so.
  const auto now = described(2);
  const kys::DistanceModel model;
  const SegmentSearch search{ScaleLevels(1.2, 8), &model, 3.5F, 80, 0.85F};
  EXPECT_NE(then.carry(*now, Rigid3(), still_), then.own());
  EXPECT_EQ(then.carry(*now, Rigid3(), still_, &search), then.own());
}

TEST_F(Wall, WhatIsInFrontOfAllHasNoSegment) {
  // Something new, 4 m away, before the wall and before the car.
  const auto at = [&](double u) {
    return carrier().segment_of(kWallCamera.back_project(u, 130, 4), Rigid3(), still_);
  };
  EXPECT_EQ(at(100), 0);
  EXPECT_EQ(at(390), 0);
  EXPECT_EQ(carrier().segment_of(kWallCamera.back_project(390, 130, kCarDepth), Rigid3(), still_),
            kCarSegment);
}

TEST_F(Wall, ACarKeepsItsIdentityWhereverItMoved) {
  const Eigen::Vector3d centre(0, 0, 1), shift(-2.4, 0, 1);
  const SegmentCarrier before = carrier(), now = carrier(centre, shift);
  const kys::InitialBelief start({}, space_);
  SegmentShifts shifts = still_;
  EXPECT_EQ(same_segments(before, now, from(centre), shifts, start)[kCarSegment - 1], 0);
  shifts[kCarSegment - 1] = shift;
  const auto same = same_segments(before, now, from(centre), shifts, start);
  EXPECT_EQ(same[kCarSegment - 1], kCarSegment);
  EXPECT_EQ(same[kWallSegment - 1], 0) << "stuff has no identity";
}

}  // namespace
}  // namespace kys_slam
