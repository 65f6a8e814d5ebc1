// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>

#include <array>
#include <cmath>
#include <limits>

#include "motion/belief.h"
#include "priors/builder/motion_belief.h"
#include "priors/fusion/appearance.h"
#include "priors/fusion/free_space.h"
#include "priors/fusion/mask_association.h"
#include "synthetic_scene.h"

namespace kys_slam {
namespace {

/// A segment of 1000 px whose flow says `residual` px, over a background of 0.5 px.
SegmentStatistics segment(double residual) {
  SegmentStatistics s;
  s.area = s.flow_count = 1000;
  s.coverage = 0.9;  // omega 1: the threshold is 1.7 x 0.5 = 0.85 px
  s.median.length = s.median.coherent = residual;
  return s;
}
const BackgroundReferences kBackground{0.5, 0, 0.5, 10000};

TEST(MotionEvidence, FlowCountsByItsRatioToTheThreshold) {
  const BuilderOptions::Detection options;
  EXPECT_NEAR(motion_evidence(options, segment(0.85 * std::exp(0.5)), kBackground).flow, 1.5, 1e-9);
  EXPECT_NEAR(motion_evidence(options, segment(0.85 / std::exp(0.5)), kBackground).flow, -1.5,
              1e-9);
  EXPECT_EQ(motion_evidence(options, segment(100), kBackground).flow, 2.5) << "limited";
  SegmentStatistics few = segment(100);
  few.flow_count = 90;
  EXPECT_FALSE(motion_evidence(options, few, kBackground).any()) << "9 % of its pixels";
}

TEST(MotionEvidence, FlowThatTheNextImageContradictsSaysNothing) {
  const BuilderOptions::Detection options;
  SegmentStatistics s = segment(20);
  s.appearance = {100, 100, 0.9, 0.9};
  const MotionEvidence still = motion_evidence(options, s, kBackground);
  EXPECT_EQ(still.flow, 0);
  EXPECT_LT(still.appearance, 0);
  s.appearance.still = 0.05;
  const MotionEvidence moves = motion_evidence(options, s, kBackground);
  EXPECT_EQ(moves.flow, 2.5);
  EXPECT_GT(moves.appearance, 2);
  s = segment(1.5);  // less than the patches can tell
  s.appearance = {100, 100, 0.9, 0.9};
  EXPECT_GT(motion_evidence(options, s, kBackground).flow, 0);
}

TEST(MotionEvidence, KeypointsThatStandSayLessThanThoseThatMove) {
  SegmentStatistics s;
  const auto nats = [&](int matches, int inliers, double log_ratio) {
    s.keypoints.matches = matches;
    s.keypoints.inliers = inliers;
    s.keypoints.log_ratio = log_ratio;
    return motion_evidence({}, s, kBackground).keypoints;
  };
  EXPECT_EQ(nats(10, 8, 0.6), -0.6);
  EXPECT_EQ(nats(10, 8, 50), -1);
  EXPECT_EQ(nats(10, 8, -50), 3);
  EXPECT_EQ(nats(10, 4, -50), 0) << "most do not fit one motion";
  EXPECT_EQ(nats(0, 0, -50), 0);
}

TEST(MotionEvidence, LookingDifferentAloneIsHidingNotMoving) {
  SegmentStatistics s = segment(0.1);
  s.appearance = {100, 100, 0.0, 0.0};
  EXPECT_LE(motion_evidence({}, s, kBackground).appearance, 0.3);
}

/// One thing per camera, seen with this residual.
TEST(MotionEvidence, AFreePlaceSaysItMovedAndConfirmsWhatLooksDifferent) {
  const BuilderOptions::Detection options;
  SegmentStatistics s;
  s.appearance = {100, 0, 0.1, 0};
  s.space = {90, 10, 0, 0.4};  // 0.1 of 100 px were free: 8 (0.1 - 0.05) nats
  EXPECT_NEAR(motion_evidence(options, s, kBackground).space, 0.4, 1e-9);
  EXPECT_NEAR(motion_evidence(options, s, kBackground).appearance, 0.3, 1e-9);
  s.space = {80, 20, 0, 0.4};
  EXPECT_NEAR(motion_evidence(options, s, kBackground).space, 1.2, 1e-9);
  EXPECT_NEAR(motion_evidence(options, s, kBackground).appearance, 2.4, 1e-9) << "8 (0.4 - 0.1)";
  s.space = {0, 100, 0, 0.4};
  EXPECT_EQ(motion_evidence(options, s, kBackground).space, 2.5) << "limited";
  s.space = {0, 100, 950, 0.4};
  EXPECT_EQ(motion_evidence(options, s, kBackground).space, 0) << "nearly all of it was hidden";
  s.space = {100, 0, 0, 0.4};
  EXPECT_EQ(motion_evidence(options, s, kBackground).space, 0) << "occupied is no proof of rest";
}

CameraFusion fusion_of(const SegmentStatistics& statistics) {
  CameraFusion fusion;
  fusion.segments = {{1, 0, true}};
  fusion.statistics = {statistics};
  fusion.decisions.resize(1);
  fusion.background = kBackground;
  return fusion;
}

/// Adds a frame and decides it at once.
void next(MotionBelief& belief, double timestamp, const std::vector<CameraFusion*>& cameras,
          const std::vector<const std::vector<std::int32_t>*>& instances) {
  belief.add_frame(timestamp, cameras, instances);
  belief.decide(cameras, instances);
}

TEST(MotionBelief, BothCamerasDecideTogetherAndWhatIsNotMeasuredKeepsItsBelief) {
  MotionBelief belief({}, true);
  const std::vector<std::int32_t> left = {65536}, right = {65536 + prior_format::kRightInstances};
  const std::vector<const std::vector<std::int32_t>*> instances = {&left, &right};
  CameraFusion a = fusion_of(segment(20)), b = fusion_of(SegmentStatistics{});
  next(belief, 0.0, {&a, &b}, instances);
  EXPECT_TRUE(a.decisions[0].dynamic);
  EXPECT_TRUE(b.decisions[0].dynamic) << "the left camera saw it move";
  EXPECT_EQ(a.decisions[0].log_odds, b.decisions[0].log_odds);

  CameraFusion c = fusion_of(SegmentStatistics{}), d = fusion_of(SegmentStatistics{});
  const double before = a.decisions[0].log_odds;
  next(belief, 0.1, {&c, &d}, instances);
  EXPECT_TRUE(c.decisions[0].dynamic) << "a car that moved keeps moving";
  EXPECT_FALSE(c.decisions[0].judged);
  EXPECT_LT(c.decisions[0].log_odds, before) << "but belief fades";
}

TEST(MotionBelief, CamerasThatShareNoInstancesDecideApart) {
  MotionBelief belief({}, false);
  const std::vector<std::int32_t> left = {65536}, right = {65536 + prior_format::kRightInstances};
  const std::vector<const std::vector<std::int32_t>*> instances = {&left, &right};
  CameraFusion a = fusion_of(segment(20)), b = fusion_of(SegmentStatistics{});
  next(belief, 0.0, {&a, &b}, instances);
  EXPECT_TRUE(a.decisions[0].dynamic);
  EXPECT_FALSE(b.decisions[0].dynamic) << "the left camera's object of this number is another one";
  EXPECT_FALSE(b.decisions[0].judged);

  belief.restore_frame(0.1, {{right[0], 5.0}});
  belief.decide({}, {});
  CameraFusion c = fusion_of(SegmentStatistics{}), d = fusion_of(SegmentStatistics{});
  const double before = a.decisions[0].log_odds;
  next(belief, 0.2, {&c, &d}, instances);
  EXPECT_LT(c.decisions[0].log_odds, before) << "it was not seen to move again";
  EXPECT_TRUE(d.decisions[0].dynamic) << "it moved in the frame that was restored";
}

TEST(MotionBelief, NothingMeasuredIsNotJudgedAndNotMoving) {
  MotionBelief belief({}, true);
  const std::vector<std::int32_t> left = {65536};
  CameraFusion a = fusion_of(SegmentStatistics{});
  next(belief, 0, {&a}, {&left});
  EXPECT_FALSE(a.decisions[0].judged);
  EXPECT_FALSE(a.decisions[0].dynamic);
}

TEST(MotionBelief, ContinuesFromWhatWasRestored) {
  const std::vector<std::int32_t> left = {65540};
  const std::vector<const std::vector<std::int32_t>*> instances = {&left};
  MotionBelief whole({}, true), resumed({}, true);
  CameraFusion first = fusion_of(segment(3)), second = fusion_of(segment(0.5)), again = second;
  next(whole, 0, {&first}, instances);
  next(whole, 0.1, {&second}, instances);
  resumed.restore_frame(0, {{65540, first.decisions[0].evidence}});
  resumed.decide({}, {});
  next(resumed, 0.1, {&again}, instances);
  EXPECT_EQ(again.decisions[0].log_odds, second.decisions[0].log_odds);
}

TEST(MotionBelief, LaterFramesCountAsTheChainOfTwoStatesSays) {
  const BuilderOptions::Detection options;
  const std::vector<std::int32_t> left = {65540};
  const std::vector<const std::vector<std::int32_t>*> instances = {&left};
  MotionBelief belief(options, true);
  CameraFusion first = fusion_of(segment(0.9));
  const std::vector<CameraFusion*> cameras = {&first};
  belief.add_frame(0, cameras, instances);
  belief.restore_frame(0.1, {{65540, 1.2}});
  belief.restore_frame(0.2, {});  // not seen
  belief.restore_frame(0.4, {{65540, 0.6}, {65541, -4.0}});
  belief.decide(cameras, instances);

  // All eight histories: 1 moves. Frames at 0, 0.1 and 0.4 s.
  const double settled = probability(options.start_log_odds);
  const auto change = [&](int from, int to, double dt) {
    const double share = 1 - std::exp(-0.2 * dt), there = to == 1 ? settled : 1 - settled;
    return share * there + (from == to ? 1 - share : 0);
  };
  std::array<double, 2> weight{};
  for (int path = 0; path < 8; ++path) {
    const int a = path & 1, b = path >> 1 & 1, c = path >> 2;
    weight[static_cast<std::size_t>(a)] +=
        (a == 1 ? settled : 1 - settled) * std::exp(a * first.decisions[0].evidence) *
        change(a, b, 0.1) * std::exp(b * 1.2) * change(b, c, 0.3) * std::exp(c * 0.6);
  }
  EXPECT_NEAR(first.decisions[0].log_odds, std::log(weight[1] / weight[0]), 1e-9);
  EXPECT_TRUE(first.decisions[0].dynamic) << "what comes later decides";
  EXPECT_LT(options.start_log_odds + first.decisions[0].evidence, 0) << "alone it would not";
}

/// Boxes of class 3, one segment each, on an image of 200x60.
PanopticMap boxes(const std::vector<std::array<int, 4>>& rectangles, std::uint16_t label = 3) {
  PanopticMap map;
  map.map = ImageOf<std::uint16_t>(200, 60);
  for (std::size_t k = 0; k < rectangles.size(); ++k) {
    const auto [x0, y0, x1, y1] = rectangles[k];
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) map.map.at(x, y) = static_cast<std::uint16_t>(k + 1);
    }
    map.segments.push_back({static_cast<std::uint32_t>(k + 1), label, true});
  }
  map.runs = find_runs(map.map);
  return map;
}

std::vector<std::int32_t> next(MaskAssociator& associator, const PanopticMap& map,
                               const SegmentLinks& links = {}) {
  return associator.next_frame(std::vector<const PanopticMap*>{&map}, links)[0];
}

TEST(MaskAssociation, AGapDoesNotSwapNeighbours) {
  MaskAssociator associator({}, {});
  EXPECT_EQ(next(associator, boxes({{20, 20, 50, 40}, {55, 20, 85, 40}})),
            (std::vector<std::int32_t>{0, 1}));
  // The first drops out: by centroids the second would take its name within 100 px.
  EXPECT_EQ(next(associator, boxes({{55, 20, 85, 40}})), (std::vector<std::int32_t>{1}));
  EXPECT_EQ(next(associator, boxes({{20, 20, 50, 40}, {55, 20, 85, 40}})),
            (std::vector<std::int32_t>{0, 1}));
}

TEST(MaskAssociation, FastThingsAreFoundWhereTheirKeypointsWent) {
  MaskAssociator associator({}, {});
  next(associator, boxes({{20, 20, 50, 40}, {100, 20, 130, 40}}));
  SegmentLinks links;  // both went 80 px to the right; the first is now where the second was
  links.shifts[0][1] = {80, 0, 5};
  links.shifts[0][2] = {80, 0, 5};
  EXPECT_EQ(next(associator, boxes({{100, 20, 130, 40}}), links), (std::vector<std::int32_t>{0}));
}

TEST(MaskAssociation, OneObjectHasOneIdentityInBothCameras) {
  MaskAssociator associator({}, {});
  const PanopticMap left = boxes({{20, 20, 50, 40}, {100, 20, 130, 40}});
  const PanopticMap right = boxes({{90, 20, 120, 40}, {10, 20, 40, 40}});
  SegmentLinks links;
  links.in_stereo[{1, 2}] = 4;
  links.in_stereo[{2, 1}] = 4;
  const auto identities =
      associator.next_frame(std::vector<const PanopticMap*>{&left, &right}, links);
  EXPECT_EQ(identities[0], (std::vector<std::int32_t>{0, 1}));
  EXPECT_EQ(identities[1], (std::vector<std::int32_t>{1, 0}));
}

TEST(MaskAssociation, TooManyThingsAreThoseOfTheirCamera) {
  const PanopticMap few = boxes({{20, 20, 50, 40}});
  PanopticMap many = few;
  many.segments.resize(2049, many.segments[0]);
  for (const std::size_t at_fault : {0u, 1u}) {
    MaskAssociator associator({}, {});
    std::size_t camera = 7;
    const std::vector<const PanopticMap*> maps{at_fault == 0 ? &many : &few,
                                               at_fault == 0 ? &few : &many};
    EXPECT_THROW(associator.next_frame(maps, {}, camera), InputError);
    EXPECT_EQ(camera, at_fault);
  }
}

TEST(MaskAssociation, DisparityLinksWhatIsTheSameThingInBothViews) {
  // The first goes 10 px to the left, onto the first; the second 30 px, onto the first and the
  // third.
  const PanopticMap left = boxes({{60, 20, 80, 40}, {90, 20, 110, 40}});
  const PanopticMap right = boxes({{50, 20, 70, 40}, {10, 20, 20, 40}, {70, 20, 80, 40}});
  ImageOf<float> disparity(200, 60);
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 200; ++x) disparity.at(x, y) = x < 85 ? 10.0F : 30.0F;
  }
  for (int x = 60; x < 80; ++x) disparity.at(x, 25) = std::numeric_limits<float>::quiet_NaN();
  disparity.at(60, 26) = 70;  // leaves the image
  const SegmentLinks::Votes expected = {
      {{1, 1}, 19 * 20 - 1}, {{2, 1}, 20 * 10}, {{2, 3}, 20 * 10}};
  EXPECT_EQ(links_by_disparity(left, right, disparity), expected);
}

TEST(MaskAssociation, TwoTracksThatTurnOutToBeOneObjectBecomeTheOlderOne) {
  const PanopticMap left = boxes({{100, 20, 130, 40}}), right = boxes({{90, 20, 120, 40}});
  const PanopticMap none = boxes({});
  const auto next_pair = [](MaskAssociator& associator, const PanopticMap& a, const PanopticMap& b,
                            const SegmentLinks& links) {
    return associator.next_frame(std::vector<const PanopticMap*>{&a, &b}, links);
  };
  for (const int pixels : {600, 20}) {
    MaskAssociator associator({}, std::vector<bool>(8, true));
    EXPECT_EQ(next_pair(associator, none, right, {})[1][0], 0) << "only the right view sees it";
    auto identities = next_pair(associator, left, right, {});
    EXPECT_EQ(identities[0][0], 1) << "nothing tells that it is the same";
    EXPECT_EQ(identities[1][0], 0);
    SegmentLinks links;
    links.by_disparity[{1, 1}] = pixels;
    identities = next_pair(associator, left, right, links);
    const bool enough = pixels == 600;
    EXPECT_EQ(identities[0][0], enough ? 0 : 1);
    EXPECT_EQ(identities[1][0], 0);
    identities = next_pair(associator, left, right, {});
    EXPECT_EQ(identities[0][0], enough ? 0 : 1) << "and stays so";
    EXPECT_EQ(identities[1][0], 0);
  }
}

TEST(MaskAssociation, OnlyPooledClassesMayChange) {
  for (const bool pooled : {false, true}) {
    MaskAssociator associator({}, std::vector<bool>(8, pooled));
    next(associator, boxes({{20, 20, 50, 40}}, 3));
    EXPECT_EQ(next(associator, boxes({{20, 20, 50, 40}}, 5))[0], pooled ? 0 : 1);
  }
}

TEST(Appearance, TellsAParkedCarFromOneThatMoves) {
  const StereoCamera camera = synthetic::kitti_camera(200, 60);
  GrayImage now(200, 60), next(200, 60);
  std::uint32_t seed = 7;
  for (std::size_t i = 0; i < now.size(); ++i) {
    seed = seed * 1664525u + 1013904223u;
    now.data()[i] = static_cast<std::uint8_t>(seed >> 24);
  }
  // The camera stands; the left box stands, the right one goes 9 px to the right.
  const PanopticMap map = boxes({{20, 20, 60, 40}, {100, 20, 140, 40}});
  FlowField flow{ImageOf<float>(200, 60), ImageOf<float>(200, 60)};
  ImageOf<float> disparity(200, 60);
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 200; ++x) {
      next.at(x, y) = now.at(x, y);
      disparity.at(x, y) = 10;
      flow.u.at(x, y) = 9;  // wrong of the left box
    }
  }
  for (int y = 20; y < 40; ++y) {
    for (int x = 100; x < 140; ++x) next.at(x + 9, y) = now.at(x, y);
  }
  EgoMotion motion;
  motion.camera = camera;
  const std::vector<AppearanceEvidence> evidence = compare_appearance(
      now, next, motion, flow, disparity, InverseDepth(camera.bf(), 255), map.runs, {0, 0, 0});
  EXPECT_GT(evidence[1].patches, 100);
  EXPECT_GT(evidence[1].still, 0.9);
  EXPECT_LT(evidence[1].flow, 0.1);
  EXPECT_LT(evidence[2].still, 0.35) << "its left edge shows what was there before";
  EXPECT_GT(evidence[2].flow, 0.5) << "patches across its border, 40 % of all, change";
}

/// Disparities of a wall of 4 px with a plate of `near` px in front of it.
ImageOf<float> plate(int x0, int x1, float near) {
  ImageOf<float> disparity(200, 60);
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 200; ++x) {
      disparity.at(x, y) = x >= x0 && x < x1 && y >= 20 && y < 40 ? near : 4;
    }
  }
  return disparity;
}

TEST(FreeSpace, TellsWhatCameFromElsewhereFromWhatWasThereOrHidden) {
  const StereoCamera camera = synthetic::kitti_camera(200, 60);
  const PanopticMap map = boxes({{60, 20, 100, 40}});
  const auto compare = [&](const ImageOf<float>& other, const Rigid3& T_other_now, float near) {
    return compare_space(camera, T_other_now, false, plate(60, 100, near), other, map.runs,
                         {false, true})[1];
  };
  const FreeSpaceEvidence moved = compare(plate(110, 150, 12), {}, 12);
  EXPECT_EQ(moved.free, 800);
  EXPECT_EQ(moved.occupied, 0);
  const FreeSpaceEvidence stood = compare(plate(60, 100, 12), {}, 12);
  EXPECT_EQ(stood.free, 0);
  EXPECT_EQ(stood.occupied, 800);
  EXPECT_EQ(compare(plate(40, 120, 24), {}, 12).free, 0) << "behind something else";
  EXPECT_EQ(compare(plate(110, 150, 12), {}, 5).free, 0) << "too far to be told from the wall";
  ImageOf<float> unknown = plate(110, 150, 12);
  for (std::size_t i = 0; i < unknown.size(); ++i) unknown.data()[i] = kNoValue;
  EXPECT_EQ(compare(unknown, {}, 12).free, 0);
}

TEST(FreeSpace, TheCamerasOwnMotionIsNotThatOfThings) {
  // The camera is now nearer by a quarter of the plate's depth. Then, its half extent was 4/5.
  StereoCamera camera = synthetic::kitti_camera(200, 60);
  camera.cx = 80;
  camera.cy = 30;
  const double depth = camera.bf() / 12;
  const Rigid3 T_other_now(Eigen::Quaterniond::Identity(), {0, 0, 0.25 * depth});
  const PanopticMap map = boxes({{60, 20, 100, 40}});
  const auto compare = [&](int x0, int x1, bool right) {
    return compare_space(camera, T_other_now, right, plate(60, 100, 12), plate(x0, x1, 12 * 0.8F),
                         map.runs, {false, true})[1];
  };
  EXPECT_EQ(compare(64, 96, false).free, 0) << "it stood";
  EXPECT_GT(compare(64, 96, false).occupied, 600);
  EXPECT_GT(compare(100, 132, false).free, 600) << "it came from the right";
  EXPECT_EQ(compare(64, 96, true).free, 0) << "motion along the optical axis: the same there";
}

}  // namespace
}  // namespace kys_slam
