// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/logic_error.h>
#include <kys_slam/system.h>

#include <string>
#include <utility>
#include <vector>

#include "map/map.h"
#include "support/feature_world.h"
#include "system/private_access.h"

namespace kys_slam {
namespace {

using testing::FeatureWorld;
using testing::weaving_pose;

constexpr int kLooks = 60;
constexpr double kStep = 0.8;  // m per frame

struct DriveResult {
  int keyframes = 0;
  double offset = 0;  // px, in the map at the end
  double error = 0;   // m, root mean square of the positions, first frames aligned
};

/// A drive of 48 m through a noisy world whose disparities all are too large by `added` px.
DriveResult drive(double added, bool calibrate,
                  const std::vector<std::pair<std::string, std::string>>& changes = {}) {
  FeatureWorld::Options options;
  options.pixel_noise = 0.4;
  options.flipped_bits = 10;
  options.length = 100;
  options.points = 8000;
  options.max_features = 800;
  const FeatureWorld world(testing::kitti_camera(), options);
  Settings settings;
  settings.set("stereo.added_disparity", std::to_string(added));
  settings.set("calibration.enabled", calibrate ? "true" : "false");
  settings.set("calibration.keyframes", "12");
  // Keyframes enough for the offset to be looked for, none taken out again.
  settings.set("keyframes.reference_ratio", "0.97");
  settings.set("mapping.redundant_share", "1");
  for (const auto& [name, value] : changes) settings.set(name, value);
  System system(world.camera(), settings, Schedule::kSequential);
  for (int i = 0; i < kLooks; ++i) system.feed(world.look(i, weaving_pose(kStep * i)));
  system.finish();
  map_of(system).check_consistency();
  DriveResult run;
  run.offset = map_of(system).rig().offset();
  run.keyframes = static_cast<int>(map_of(system).keyframes().size());
  const Rigid3 T_0_w = weaving_pose(0).inverse();
  for (const FrameEstimate& estimate : system.trajectory()) {
    EXPECT_TRUE(estimate.connected);
    const Rigid3 truth = T_0_w * weaving_pose(kStep * static_cast<double>(estimate.index));
    run.error += (truth.t() - estimate.T_w_c.t()).squaredNorm() / kLooks;
  }
  run.error = std::sqrt(run.error);
  return run;
}

TEST(SystemCalibration, AWrongDisparityIsFoundAndTheTrajectoryPutRight) {
  const DriveResult without = drive(0.3, false);
  const DriveResult with = drive(0.3, true);
  RecordProperty("error_without_m", std::to_string(without.error));
  RecordProperty("error_with_m", std::to_string(with.error));
  ASSERT_GE(with.keyframes, 12) << "the offset was never looked for";
  EXPECT_EQ(without.offset, 0);
  EXPECT_NEAR(with.offset, -0.3, 0.12);
  EXPECT_LT(with.error, 0.6 * without.error)
      << with.error << " m against " << without.error << " m, offset " << with.offset << ", "
      << with.keyframes << " keyframes";
}

/// The estimates from 8 and 16 keyframes are not certain enough; the run ends before there are 64.
TEST(SystemCalibration, TheEndOfAShortRunIsLookedAtAsWell) {
  const DriveResult run = drive(0.3, true,
                                {{"calibration.keyframes", "8"},
                                 {"calibration.systematic", "0"},
                                 {"calibration.significance", "25"}});
  ASSERT_LT(run.keyframes, 64);
  EXPECT_LT(run.offset, -0.1);
  const DriveResult without = drive(0.3, false);
  EXPECT_LT(run.error, 0.6 * without.error) << run.error << " m against " << without.error << " m";
}

TEST(SystemCalibration, ARigWithoutErrorIsNotTouched) {
  const DriveResult with = drive(0, true);
  ASSERT_GE(with.keyframes, 12) << "the offset was never looked for";
  EXPECT_EQ(with.offset, 0);
  EXPECT_LT(with.error, 0.1);
}

/// As from a file that states no uncertainty.
TEST(SystemCalibration, ARunMayBeginWithACorrectionThatIsSaidToBeExact) {
  FeatureWorld::Options options;
  options.pixel_noise = 0.2;
  options.length = 100;
  options.points = 8000;
  options.max_features = 800;
  const FeatureWorld world(testing::kitti_camera(), options);
  System system(world.camera(), Settings(), Schedule::kSequential);
  RigCorrection::Parameters parameters = RigCorrection::Parameters::Zero();
  constexpr int kRoll = static_cast<int>(RigParameter::kRoll);
  parameters[kRoll] = 1e-4;
  system.start_rig(RigCorrection(world.camera(), parameters));
  for (int i = 0; i < 30; ++i) system.feed(world.look(i, weaving_pose(kStep * i)));
  system.finish();
  const RigReport rig = system.rig();
  EXPECT_TRUE(rig.applied.correction.bends());
  EXPECT_NEAR(rig.applied.correction.parameters()[kRoll], 1e-4, 3e-5);
  EXPECT_THROW(system.start_rig({}), LogicError) << "after the first frame";
}

}  // namespace
}  // namespace kys_slam
