// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/keyframe_policy.h"

#include <gtest/gtest.h>

namespace kys_slam {
namespace {

/// A frame that tracks well, long after the last keyframe of a map of many: no keyframe is due.
KeyFrameSituation calm() {
  KeyFrameSituation s;
  s.frames_since_keyframe = 5;
  s.keyframes_in_map = 10;
  s.inliers = 190;
  s.reference_landmarks = 200;
  s.tracked_close = 150;
  s.untracked_close = 10;
  s.waiting = 0;
  return s;
}

TEST(KeyFramePolicy, AFrameThatTracksWellIsNoKeyframe) {
  const KeyFramePolicyOptions o;
  EXPECT_FALSE(needs_keyframe(calm(), o));
  KeyFrameSituation s = calm();
  s.frames_since_keyframe = 1000;
  EXPECT_FALSE(needs_keyframe(s, o)) << "time alone makes none: the view has to change";
}

TEST(KeyFramePolicy, OneIsDueBelowTheShareOfTheReference) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.inliers = 170;
  EXPECT_FALSE(needs_keyframe(s, o)) << "0.85 exactly";
  s.inliers = 169;
  EXPECT_TRUE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, AMapOfOneKeyframeAsksForLess) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.keyframes_in_map = 1;
  s.inliers = 80;
  EXPECT_FALSE(needs_keyframe(s, o)) << "0.4 exactly";
  s.inliers = 79;
  EXPECT_TRUE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, ClosePointsThatRunShortCallForOne) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.tracked_close = 99;
  s.untracked_close = 71;
  EXPECT_TRUE(needs_keyframe(s, o)) << "although the reference is still in view";
  s.tracked_close = 100;
  EXPECT_FALSE(needs_keyframe(s, o));
  s.tracked_close = 99;
  s.untracked_close = 70;
  EXPECT_FALSE(needs_keyframe(s, o)) << "there is nothing to be added";
}

TEST(KeyFramePolicy, ManyMoreClosePointsToAddThanTrackedCallForOne) {
  KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.tracked_close = 150;
  s.untracked_close = 450;
  EXPECT_FALSE(needs_keyframe(s, o)) << "three times as many exactly";
  s.untracked_close = 451;
  EXPECT_TRUE(needs_keyframe(s, o)) << "although the reference is still in view";
  s.waiting = 1;
  EXPECT_TRUE(needs_keyframe(s, o)) << "although the back end is busy";
  s.tracked_close = 0;
  s.untracked_close = 70;
  EXPECT_FALSE(needs_keyframe(s, o)) << "there is little to be added";
  s.tracked_close = 150;
  s.untracked_close = 451;
  o.untracked_ratio = 0;
  EXPECT_FALSE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, WhereLittleIsTrackedWhatCanBeAddedCallsForOne) {
  KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.inliers = s.reference_landmarks = 99;
  s.addable = 50;
  EXPECT_TRUE(needs_keyframe(s, o)) << "although the reference is still in view";
  s.addable = 49;
  EXPECT_FALSE(needs_keyframe(s, o)) << "less than half as many again";
  s.addable = 500;
  s.inliers = s.reference_landmarks = 100;
  EXPECT_FALSE(needs_keyframe(s, o)) << "enough is tracked";
  s.inliers = 99;
  o.min_tracked = 0;
  EXPECT_FALSE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, EveryFrameCanBecomeOneUnlessTheBackEndIsFarBehind) {
  KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.waiting = 1;
  EXPECT_FALSE(needs_keyframe(s, o));
  o.every_frame = true;
  EXPECT_TRUE(needs_keyframe(s, o));
  s.waiting = o.max_waiting + 1;
  EXPECT_FALSE(needs_keyframe(s, o)) << "a backlog";
  s.waiting = 0;
  s.inliers = o.min_inliers;
  EXPECT_FALSE(needs_keyframe(s, o)) << "its pose is not sure";
}

TEST(KeyFramePolicy, WaitsForTheMinimumOfFrames) {
  KeyFramePolicyOptions o;
  o.min_frames = 3;
  KeyFrameSituation s = calm();
  s.inliers = 120;
  s.frames_since_keyframe = 2;
  EXPECT_FALSE(needs_keyframe(s, o));
  s.frames_since_keyframe = 3;
  EXPECT_TRUE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, ABusyMapperIsSparedUntilOneIsOverdueOrTrackingStarves) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.inliers = 120;
  s.waiting = 1;
  EXPECT_FALSE(needs_keyframe(s, o));
  s.frames_since_keyframe = 30;
  EXPECT_TRUE(needs_keyframe(s, o)) << "overdue";
  s.frames_since_keyframe = 5;
  s.inliers = 49;
  EXPECT_TRUE(needs_keyframe(s, o)) << "less than a quarter";
  s.inliers = 120;
  s.tracked_close = 20;
  s.untracked_close = 200;
  EXPECT_TRUE(needs_keyframe(s, o)) << "close points run short";
}

TEST(KeyFramePolicy, ABacklogStopsEverything) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.inliers = 30;
  s.frames_since_keyframe = 100;
  s.waiting = 4;
  EXPECT_TRUE(needs_keyframe(s, o));
  s.waiting = 5;
  EXPECT_FALSE(needs_keyframe(s, o));
}

TEST(KeyFramePolicy, APoorPoseMakesNoKeyframe) {
  const KeyFramePolicyOptions o;
  KeyFrameSituation s = calm();
  s.inliers = 15;
  EXPECT_FALSE(needs_keyframe(s, o));
  s.inliers = 16;
  EXPECT_TRUE(needs_keyframe(s, o));
}

}  // namespace
}  // namespace kys_slam
