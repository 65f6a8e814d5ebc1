// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/landmarks.h"

#include <gtest/gtest.h>

#include <cmath>

namespace kys_slam::simulator {
namespace {

/// Whether the camera finds a landmark ahead of it, and at which octave, where the octave by the
/// formula is `level`.
bool found_at(double level, Sight& sight) {
  const StereoCamera camera{640, 192, 360, 360, 320, 96, 0.54};
  Landmark l;
  l.max_distance = 40;
  l.max_level = 100;
  l.min_cosine = 0.5F;
  l.normal = -Eigen::Vector3f::UnitZ();
  l.p_w = {0, 0, l.max_distance / std::pow(kFeatureScale, level)};
  return sees(camera, l, Rigid3(), Rigid3(), sight);
}

// Octaves are counted in arrays of kFeatureLevels.
TEST(Landmarks, TheOctaveIsOneOfThePyramid) {
  Sight sight{};
  ASSERT_TRUE(found_at(7.9, sight));
  EXPECT_FLOAT_EQ(sight.level, 7.9F);
  EXPECT_FALSE(found_at(8.1, sight));
  for (double below = 1e-4; below > 1e-12; below /= 3) {
    if (!found_at(kFeatureLevels - below, sight)) continue;
    EXPECT_LT(static_cast<int>(sight.level), kFeatureLevels) << below;
  }
}

}  // namespace
}  // namespace kys_slam::simulator
