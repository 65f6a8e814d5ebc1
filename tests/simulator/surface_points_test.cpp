// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/images/surface_points.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cmath>
#include <cstring>
#include <set>

#include "simulator/images/renderer.h"

namespace kys_slam::simulator {
namespace {

struct SurfaceSample {
  Eigen::Vector3f p, normal;
  std::int32_t label;
};
static_assert(sizeof(SurfaceSample) == 28);

std::vector<SurfaceSample> samples_of(const std::string& ply) {
  const std::size_t at = ply.find("end_header\n") + std::strlen("end_header\n");
  std::vector<SurfaceSample> samples((ply.size() - at) / sizeof(SurfaceSample));
  std::memcpy(static_cast<void*>(samples.data()), ply.data() + at,
              samples.size() * sizeof(SurfaceSample));
  return samples;
}

World small_world() {
  WorldOptions options;
  options.name = "street";
  options.frames = 3;
  options.width = 310;
  options.height = 94;
  return make_world(options);
}

TEST(SurfacePoints, LieOnWhatTheCameraSees) {
  const World world = small_world();
  const std::vector<SurfaceSample> samples = samples_of(surface_ply(world, 2000, 5));
  ASSERT_EQ(samples.size(), 2000U);
  const RenderAssets assets(world);
  FrameRenderer renderer(assets);
  const Rigid3 T_w_0 = world.T_w_c.front();
  std::vector<bool> seen(samples.size(), false);
  int hidden = 0, looked = 0;
  for (int frame = 0; frame < 3; ++frame) {
    const ViewTruth truth = renderer.truth(frame, 0);
    const Rigid3 T_c_0 = world.T_w_truth[static_cast<std::size_t>(frame)].inverse() * T_w_0;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const Eigen::Vector3d p_c = T_c_0 * samples[k].p.cast<double>();
      if (p_c.z() < 1) continue;
      const Eigen::Vector2d pixel = world.rectified.project(p_c);
      if (!world.rectified.in_image(pixel.x(), pixel.y())) continue;
      const float depth = truth.depth.at(static_cast<int>(std::lround(pixel.x())),
                                         static_cast<int>(std::lround(pixel.y())));
      ++looked;
      const bool on = depth > 0 && std::abs(depth - p_c.z()) < 0.05 * p_c.z();
      seen[k] = seen[k] || on;
      hidden += depth > 0 && p_c.z() > 1.05 * depth ? 1 : 0;
      // Nothing floats before what is seen, but at edges within a pixel.
    }
  }
  ASSERT_GT(looked, 2000);
  EXPECT_GT(std::count(seen.begin(), seen.end(), true), 1800) << "pixels of an edge may differ";
  EXPECT_LT(hidden, looked / 3);
  std::set<int> classes;
  for (const SurfaceSample& s : samples) {
    EXPECT_NEAR(s.normal.norm(), 1, 1e-4);
    classes.insert(s.label);
  }
  EXPECT_GT(classes.size(), 3U);
}

TEST(SurfacePoints, AreTheSameForTheSameSeed) {
  const World world = small_world();
  const std::string one = surface_ply(world, 300, 5);
  EXPECT_EQ(surface_ply(world, 300, 5), one);
  EXPECT_NE(surface_ply(world, 300, 6), one);
}

}  // namespace
}  // namespace kys_slam::simulator
