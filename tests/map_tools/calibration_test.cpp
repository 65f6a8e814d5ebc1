// SPDX-License-Identifier: BSD-3-Clause
#include "calibration.h"

#include <gtest/gtest.h>
#include <kys_slam/rig_rows.h>

#include <algorithm>
#include <atomic>
#include <vector>

#include "simulated_recordings.h"

namespace kys_slam {
namespace {

using simulator::RigError;
using simulator::TruePair;
using testing::kKitti;
using testing::SimulatedDrive;

CalibrationOptions options() {
  CalibrationOptions o;
  o.prior = rig_prior();
  return o;
}

/// The given calibration.
RigEstimate given() {
  return {RigCorrection(kKitti, RigCorrection::Parameters::Zero()), rig_prior()};
}

/// What an estimate predicts wrongly of disparities and rows over the image.
struct FieldError {
  double worst = 0;  ///< px
  double score = 0;  ///< root mean square of errors over their standard deviations
};

FieldError field_error(const RigError& truth, const RigEstimate& estimate) {
  const TruePair pair(kKitti, truth);
  FieldError error;
  int count = 0;
  for (double u = 100; u < kKitti.width - 60; u += 120) {
    for (double v = 30; v < kKitti.height; v += 60) {
      for (const double depth : {8.0, 30.0, 1000.0}) {
        const Eigen::Vector3d p_c = kKitti.back_project(u, v, depth);
        const Eigen::Vector4d at = pair.observe(p_c);
        const Prediction p = predict(kKitti, estimate.correction, p_c, true);
        const Eigen::Vector2d off(p.value[2] - (at[0] - at[2]), p.value[3] - (at[3] - at[1]));
        const Eigen::Matrix<double, 2, RigCorrection::kSize> J = p.by_rig.bottomRows<2>();
        const Eigen::Vector2d variance = (J * estimate.covariance * J.transpose()).diagonal();
        error.worst = std::max(error.worst, off.cwiseAbs().maxCoeff());
        error.score += off.cwiseAbs2().cwiseQuotient(variance).sum();
        count += 2;
      }
    }
  }
  error.score = std::sqrt(error.score / count);
  return error;
}

/// The rig in a recording: the shape stays, the rest changes a little.
RigError on_day(RigError error, int day) {
  error.cx += 0.2 * day;
  error.cy -= 0.15 * day;
  error.pitch += 0.0003 * day;
  error.roll += 0.0002 * day;
  return error;
}

std::vector<Recording> three_days(const RigError& error) {
  std::vector<Recording> recordings;
  for (int day = 0; day < 3; ++day) {
    SimulatedDrive drive;
    drive.seed = static_cast<unsigned>(day) + 1;
    recordings.push_back(testing::simulate(on_day(error, day), drive));
  }
  return recordings;
}

/// A mild error, of which terms of second order are below a hundredth of a pixel.
RigError mild_error() {
  RigError error;
  error.focal = 0.997;
  error.left = {0.006, -0.002, 0.0004, -0.0005};
  error.right = {0.008, -0.003, -0.0005, -0.0008};
  error.yaw = 0.002;
  error.pitch = -0.001;
  error.roll = 0.0006;
  error.focal_ratio = 1.0008;
  error.cx = 1.5;
  error.cy = 0.6;
  error.baseline_y = 0.002;
  error.baseline_z = -0.003;
  return error;
}

TEST(Calibration, FindsTheFieldsOfDisparitiesAndRows) {
  const RigError error = mild_error();
  std::vector<Recording> recordings = three_days(error);
  const CalibrationResult result = calibrate(recordings, options());
  for (int day = 0; day < 3; ++day) {
    SCOPED_TRACE(day);
    const RecordingResult& r = result.recordings[static_cast<std::size_t>(day)];
    const FieldError before = field_error(on_day(error, day), given());
    const FieldError after = field_error(on_day(error, day), r.rig);
    EXPECT_GT(before.worst, 0.5) << "px: there is something to find";
    EXPECT_LT(after.worst, 0.05) << "px";
    EXPECT_LT(after.score, 2) << "deviations";
    EXPECT_GT(r.before.sigma[3], 0.2);
    EXPECT_LT(r.after.sigma[3], 0.1) << "px, noise of 0.08 px";
    EXPECT_LT(r.after.sigma[2], r.before.sigma[2]);
  }
}

TEST(Calibration, LeavesOutTermsOfSecondOrderOnly) {
  const RigError error = simulator::make_rig_error("kitti", kKitti);
  std::vector<Recording> recordings = three_days(error);
  const CalibrationResult result = calibrate(recordings, options());
  // Of a yaw of 17.6 px: fx yaw^2 x^3 at the border of the image.
  const double x = kKitti.cx / kKitti.fx;
  const double second_order = 17.6 * 17.6 / kKitti.fx * x * x * x;
  for (int day = 0; day < 3; ++day) {
    const RecordingResult& r = result.recordings[static_cast<std::size_t>(day)];
    EXPECT_GT(field_error(on_day(error, day), given()).worst, 10 * second_order);
    EXPECT_LT(field_error(on_day(error, day), r.rig).worst, second_order);
  }
}

TEST(Calibration, AShapeThatIsKeptFitsAnotherRecording) {
  const RigError error = mild_error();
  std::vector<Recording> recordings = three_days(error);
  std::vector<Recording> others(recordings.begin(), recordings.begin() + 2);
  std::vector<Recording> third(recordings.begin() + 2, recordings.end());
  const CalibrationResult of_others = calibrate(others, options());
  CalibrationOptions kept = options();
  kept.start = of_others.estimate(kKitti, kept.prior).correction.parameters();
  for (const int place : own_places()) kept.start[place] = 0;
  kept.keep_shape = true;
  const CalibrationResult result = calibrate(third, kept);
  for (const int place : shape_places()) {
    EXPECT_EQ(result.recordings[0].rig.correction.parameters()[place], kept.start[place]);
    EXPECT_LT(result.recordings[0].rig.covariance(place, place), 1e-12);
  }
  const RigEstimate found{result.recordings[0].rig.correction,
                          of_others.recordings[0].rig.covariance};
  EXPECT_LT(field_error(on_day(error, 2), found).score, 2) << "deviations of the kept shape";
  // As good as its own shape.
  std::vector<Recording> alone(recordings.begin() + 2, recordings.end());
  const CalibrationResult own = calibrate(alone, options());
  for (int c = 0; c < 4; ++c) {
    EXPECT_LT(result.recordings[0].after.sigma[c], 1.1 * own.recordings[0].after.sigma[c]);
  }
}

TEST(Calibration, WithoutRowsTheyStayUncertain) {
  SimulatedDrive drive;
  drive.rows = false;
  std::vector<Recording> recordings{testing::simulate(mild_error(), drive)};
  const RigEstimate rig = calibrate(recordings, options()).recordings[0].rig;
  const int row = static_cast<int>(RigParameter::kRow);
  EXPECT_GT(rig.covariance(row, row), 0.5 * rig_prior()(row, row));
}

TEST(Calibration, IsTheSameEveryTime) {
  SimulatedDrive drive;
  drive.landmarks = 400;
  std::vector<Recording> one{testing::simulate(mild_error(), drive)};
  drive.seed = 2;
  one.push_back(testing::simulate(mild_error(), drive));
  std::vector<Recording> two(2), three = one;
  two[1] = one[1];  // memory in the other order: the result does not depend on addresses
  two[0] = one[0];
  const RigEstimate a = calibrate(one, options()).recordings[0].rig;
  const RigEstimate b = calibrate(two, options()).recordings[0].rig;
  EXPECT_EQ(a.correction.parameters(), b.correction.parameters());
  EXPECT_EQ(a.covariance, b.covariance);
  CalibrationOptions other = options();
  other.seed = 2;
  EXPECT_NE(calibrate(three, other).recordings[0].rig.correction.parameters(),
            a.correction.parameters())
      << "others are held out";
}

TEST(Calibration, StopsWithTheBestSoFar) {
  std::vector<Recording> recordings = three_days(mild_error());
  std::atomic<bool> stop{false};
  CalibrationOptions stopped = options();
  stopped.watch.stop = &stop;
  int rig_iterations = 0;
  stopped.watch.progress = [&](int, int, const std::string& what) {
    if (what == "calibration" && ++rig_iterations == 6) stop = true;
  };
  const CalibrationResult result = calibrate(recordings, stopped);
  EXPECT_TRUE(result.stopped);
  EXPECT_EQ(rig_iterations, 6);
  EXPECT_LT(result.recordings[0].after.sigma[3], result.recordings[0].before.sigma[3]);
}

TEST(Prediction, DerivativesAreThoseOfDifferences) {
  RigCorrection::Parameters values;
  values << 0.011, -0.004, 0.001, -0.002, 0.009, -0.003, -0.001, -0.006, 0.02, 0.004, 0.002, 0.001,
      0.6, -0.4, 0.003, -0.006, -0.008;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(-4, -1.2, 9), {3, 1.5, 6}, {20, -4, 60}}) {
    const Prediction at = predict(kKitti, RigCorrection(kKitti, values), p, true);
    for (int k = 0; k < RigCorrection::kSize; ++k) {
      SCOPED_TRACE(rig_parameter_names()[static_cast<std::size_t>(k)].name);
      constexpr double kStep = 1e-6;
      RigCorrection::Parameters more = values, less = values;
      more[k] += kStep;
      less[k] -= kStep;
      const Eigen::Vector4d difference =
          (predict(kKitti, RigCorrection(kKitti, more), p, false).value -
           predict(kKitti, RigCorrection(kKitti, less), p, false).value) /
          (2 * kStep);
      EXPECT_LT((at.by_rig.col(k) - difference).norm(), 1e-3 * (1 + difference.norm()))
          << at.by_rig.col(k).transpose() << "  " << difference.transpose();
    }
    for (int k = 0; k < 3; ++k) {
      constexpr double kStep = 1e-5;  // m
      const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(k);
      const Eigen::Vector4d difference =
          (predict(kKitti, RigCorrection(kKitti, values), p + d, false).value -
           predict(kKitti, RigCorrection(kKitti, values), p - d, false).value) /
          (2 * kStep);
      EXPECT_LT((at.by_point.col(k) - difference).norm(), 1e-3 * (1 + difference.norm()));
    }
  }
}

}  // namespace
}  // namespace kys_slam
