// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/row_field.h>
#include <kys_slam/settings.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ostream>
#include <string>
#include <vector>

#include "simulator/common/euroc_rig.h"
#include "simulator/common/rig_error.h"
#include "simulator/images/renderer.h"

// The field of row differences, measured in rendered pairs whose error is known.
namespace kys_slam::simulator {
namespace {

RowField measure(const World& world, const std::vector<int>& frames,
                 const RigEstimate& known = {RigCorrection(), rig_prior()}) {
  const RenderAssets assets(world);
  FrameRenderer renderer(assets);
  RowMeter meter(world.rectified, known);
  for (const int frame : frames) {
    GrayImage left = renderer.image(frame, 0), right = renderer.image(frame, 1);
    if (world.layout == Layout::kEuroc) {
      const StereoRectifier rectifier = euroc_rectifier(left.width(), left.height());
      left = rectifier.rectify_left(left);
      right = rectifier.rectify_right(right);
    }
    meter.add(left, right);
  }
  return meter.field();
}

/// Right row less left row that the true cameras have, where the columns of a match say it is.
double true_difference(const TruePair& cameras, const RigCorrection::Measured& m) {
  double v_right = m.v;
  for (int i = 0; i < 10; ++i) {
    v_right -= cameras.pair_ideal(m.u, m.v, m.u_right, v_right).row_difference;
  }
  return v_right - m.v;
}

double quantile(std::vector<double> v, double share) {
  const auto at = static_cast<long>(share * static_cast<double>(v.size()));
  std::nth_element(v.begin(), v.begin() + at, v.end());
  return v[static_cast<std::size_t>(at)];
}

/// Of the matches of a cell, px.
struct CellTruth {
  std::vector<double> rows;    // true differences
  std::vector<double> errors;  // of the measured ones
};
using Truth = std::array<std::array<CellTruth, RowField::kColumns>, RowField::kRows>;

Truth truth_of(const RowField& field, const TruePair& cameras, const StereoCamera& camera) {
  Truth truth;
  for (const RowObservation& match : field.matches) {
    const RigCorrection::Measured& m = match.measured;
    const auto row = static_cast<std::size_t>(m.v * RowField::kRows / camera.height);
    const auto column = static_cast<std::size_t>(m.u * RowField::kColumns / camera.width);
    CellTruth& cell = truth.at(row).at(column);
    cell.rows.push_back(true_difference(cameras, m));
    cell.errors.push_back(m.v_right - m.v - cell.rows.back());
  }
  return truth;
}

struct Case {
  const char* world;
  const char* error;
  std::vector<int> frames;
  int width, height;
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.world << " " << c.error;
}

class BentRows : public testing::TestWithParam<Case> {};

TEST_P(BentRows, MediansOfTheCellsAreTheTruth) {
  const auto& [name, error_text, frames, width, height] = GetParam();
  World world = make_world({name, 3, frames.back() + 2, width, height});
  const StereoCamera given = world.rectified;
  const RigError error = make_rig_error(error_text, given);
  apply_rig_error(world, error);
  const RowField field = measure(world, frames);
  const Truth truth = truth_of(field, TruePair(given, error), given);
  EXPECT_EQ(field.pairs, frames.size());
  EXPECT_GT(field.stereo_matches, field.matches.size());
  int cells = 0;
  double largest = 0;
  for (std::size_t row = 0; row < RowField::kRows; ++row) {
    for (std::size_t column = 0; column < RowField::kColumns; ++column) {
      SCOPED_TRACE("row " + std::to_string(row) + ", column " + std::to_string(column));
      const RowField::Cell& cell = field.cells[row][column];
      const CellTruth& known = truth[row][column];
      ASSERT_EQ(cell.matches, known.rows.size());
      EXPECT_EQ(std::isnan(cell.median), cell.matches < RowField::kLeastInCell);
      EXPECT_EQ(std::isnan(cell.median_after), std::isnan(cell.median));
      if (cell.matches < 20) continue;
      ++cells;
      EXPECT_NEAR(quantile(known.errors, 0.5), 0, 0.1);
      EXPECT_NEAR(cell.median_after, 0, 0.1);
      // Within a cell the field changes by up to 1 px, with gaps where nothing is matched.
      EXPECT_GT(cell.median, quantile(known.rows, 0.4) - 0.1);
      EXPECT_LT(cell.median, quantile(known.rows, 0.6) + 0.1);
      largest = std::max(largest, std::abs(quantile(known.rows, 0.5)));
    }
  }
  EXPECT_GE(cells, 12);
  EXPECT_GT(largest, 0.4) << "the case shows nothing";
  EXPECT_GE(field.largest(), largest - 0.1);
  EXPECT_EQ(field.verdict(), RowVerdict::kUnrectified);
  EXPECT_EQ(field.describe().rfind("not rectified: rows differ by up to ", 0), 0U)
      << field.describe();
  EXPECT_LT(field.fit.sigma_after, field.fit.sigma_before);
}

INSTANTIATE_TEST_SUITE_P(Worlds, BentRows,
                         testing::Values(Case{"street", "kitti", {0, 30, 60}, 1241, 376},
                                         Case{"block", "random:3", {0, 30, 60}, 1241, 376},
                                         Case{"hall", "random:4", {0, 30, 60}, 752, 480}));

TEST(Rows, APerfectPairIsRectified) {
  for (const char* name : {"street", "hall"}) {
    const bool hall = name == std::string("hall");
    const World world = make_world({name, 3, 12, hall ? 752 : 1241, hall ? 480 : 376});
    const RowField field = measure(world, {0, 10});
    EXPECT_EQ(field.verdict(), RowVerdict::kRectified);
    EXPECT_LT(field.fit.field, 0.05) << name;
    EXPECT_EQ(field.describe().rfind("rectified (rows agree to 0.0", 0), 0U) << field.describe();
    EXPECT_EQ(field.verdict(0), RowVerdict::kUnrectified) << "nothing agrees to 0 px";
  }
}

TEST(Rows, WhatAGivenCorrectionLeavesIsMeasured) {
  World world = make_world({"street", 3, 12, 1241, 376});
  apply_rig_error(world, make_rig_error("kitti", world.rectified));
  const RowField bent = measure(world, {0, 10});
  ASSERT_EQ(bent.verdict(), RowVerdict::kUnrectified);
  const RowField left = measure(world, {0, 10}, bent.fit.rig);
  EXPECT_EQ(left.verdict(), RowVerdict::kRectified) << left.describe();
  EXPECT_LT(left.fit.field, 0.05);
  EXPECT_LT(left.fit.sigma_before, 1.5 * bent.fit.sigma_after);
}

TEST(Rows, PairsWithoutTextureTellNothing) {
  const StereoCamera camera{320, 240, 250, 250, 160, 120, 0.2};
  RowMeter meter(camera);
  EXPECT_EQ(meter.field().verdict(), RowVerdict::kUnknown) << "no pair at all";
  const GrayImage grey(320, 240, 90);
  meter.add(grey, grey);
  const RowField field = meter.field();
  EXPECT_EQ(field.pairs, 1U);
  EXPECT_EQ(field.matches.size(), 0U);
  EXPECT_EQ(field.verdict(), RowVerdict::kUnknown);
  EXPECT_EQ(field.largest(), 0);
  EXPECT_TRUE(std::isnan(field.cells[0][0].median));
  EXPECT_EQ(field.describe().rfind("too few matches to tell: 0 ", 0), 0U) << field.describe();
}

TEST(Rows, ImagesOfAnotherSizeAreRefused) {
  RowMeter meter(StereoCamera{320, 240, 250, 250, 160, 120, 0.2});
  EXPECT_THROW(meter.add(GrayImage(320, 240), GrayImage(320, 241)), InputError);
  EXPECT_THROW(meter.add(GrayImage(), GrayImage()), InputError);
}

TEST(Rows, TheVerdictIsThatOfARun) {
  EXPECT_EQ(std::stod(Settings().get("calibration.min_field")), RowField::kMinField);
}

}  // namespace
}  // namespace kys_slam::simulator
