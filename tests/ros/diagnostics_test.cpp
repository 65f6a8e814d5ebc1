// SPDX-License-Identifier: BSD-3-Clause
#include "diagnostics.h"

#include <gtest/gtest.h>

namespace kys_slam::ros {
namespace {

using Health = Diagnostics::Level;

FrameReport frame_of(int index, FrameStatus status = FrameStatus::kTracked) {
  FrameReport report;
  report.index = index;
  report.timestamp = 0.05 * index;
  report.status = status;
  return report;
}

TEST(DiagnosticsLog, TheWorstFrameSinceTheLastReportCounts) {
  DiagnosticsLog log;
  log.add(frame_of(0));
  FrameReport doubtful = frame_of(1);
  doubtful.integrity = Integrity::kDegraded;
  doubtful.integrity_reason = IntegrityReason::kFewPoints;
  log.add(doubtful);
  log.add(frame_of(2));
  Diagnostics state = log.take({});
  EXPECT_EQ(state.level, Health::kWarn);
  EXPECT_EQ(state.message, std::string("degraded: ") + to_string(IntegrityReason::kFewPoints));
  doubtful.integrity = Integrity::kContradicted;
  doubtful.integrity_reason = IntegrityReason::kTwoMotions;
  log.add(doubtful);
  log.add(frame_of(3));
  state = log.take({});
  EXPECT_EQ(state.level, Health::kError);
  EXPECT_EQ(state.message, std::string("contradicted: ") + to_string(IntegrityReason::kTwoMotions));
  FrameReport lost = frame_of(4, FrameStatus::kLost);
  lost.reason = "too few matches";
  log.add(lost);
  log.add(doubtful);
  EXPECT_EQ(log.take({}).message, "lost: too few matches");
  log.add(frame_of(5));
  state = log.take({});
  EXPECT_EQ(state.level, Health::kOk);
  EXPECT_EQ(state.message, "ok");
}

TEST(DiagnosticsLog, LossesOfTheLastPeriodAlone) {
  DiagnosticsLog log;
  PairCounts counts;
  counts.dropped = 3;
  log.add(frame_of(0));
  EXPECT_EQ(log.take(counts).level, Health::kWarn);
  log.add(frame_of(1));
  EXPECT_EQ(log.take(counts).level, Health::kOk);
  counts.unmatched = 7;
  EXPECT_EQ(log.take(counts).message, "images without a partner");
  EXPECT_EQ(log.take(counts).message, "no images");
  counts.out_of_order = 2;
  EXPECT_EQ(log.take(counts).message, "stamps of images do not increase");
  ++counts.paired;
  EXPECT_EQ(log.take(counts).message, "pairs wait to be tracked");
}

TEST(DiagnosticsLog, WhatKeepsFromTrackingComesFirst) {
  DiagnosticsLog log;
  log.info_changed = true;
  log.add(frame_of(0));
  EXPECT_EQ(log.take({}).level, Health::kWarn);
  log.missing_info = "right";
  EXPECT_EQ(log.take({}).message, "no camera_info of right");
  log.error = "a calibration that cannot be";
  EXPECT_EQ(log.take({}).message, "a calibration that cannot be");
  log.restart();
  log.missing_info.clear();
  log.add(frame_of(1));
  EXPECT_EQ(log.take({}).level, Health::kOk);
}

}  // namespace
}  // namespace kys_slam::ros
