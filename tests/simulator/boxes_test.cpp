// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/boxes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "simulator/common/rng.h"

namespace kys_slam::simulator {
namespace {

using Eigen::Vector3d;

const StereoCamera kCamera{640, 192, 360, 360, 320, 96, 0.54};

struct Scene {
  std::vector<std::int32_t> objects;
  std::vector<Rigid3> T_w_o;
  std::vector<Vector3d> half;
  std::vector<SeenBox> all;  ///< whether in view or not
};

// Cars ahead of the camera, beside it and behind: many of them reach past it. No one holds it.
Scene random_scene(std::uint64_t seed, int count) {
  Rng rng(seed);
  Scene s;
  while (static_cast<int>(s.objects.size()) < count) {
    SeenBox box;
    box.object = static_cast<std::int32_t>(s.objects.size());
    box.half = {rng.uniform(0.3, 1.2), rng.uniform(0.3, 1.5), rng.uniform(1, 5)};
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(rng.uniform(-M_PI, M_PI), Vector3d::UnitY()));
    const Rigid3 T_c_o(turn, {rng.uniform(-6, 6), rng.uniform(-1, 1.5), rng.uniform(-6, 20)});
    box.T_o_c = T_c_o.inverse();
    if ((box.T_o_c.t().cwiseAbs() - box.half).maxCoeff() < 0.01) continue;
    s.objects.push_back(box.object);
    s.T_w_o.push_back(T_c_o);
    s.half.push_back(box.half);
    s.all.push_back(box);
  }
  return s;
}

Vector3d ray_at(double u, double v) {
  return {(u - kCamera.cx) / kCamera.fx, (v - kCamera.cy) / kCamera.fy, 1};
}

// Every ray of the image that meets a box lies in its outline, and meets it no nearer than its
// smallest depth. The outline is not the whole image for all that reach past the camera.
TEST(Boxes, OutlineHoldsAllThatTheBoxCovers) {
  int hits = 0, reach_past = 0, cut = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Scene scene = random_scene(seed, 30);
    const auto seen = boxes_in_view(kCamera, Rigid3(), scene.objects, scene.T_w_o, scene.half);
    for (const SeenBox& b : scene.all) {
      const auto found = std::ranges::find(seen, b.object, &SeenBox::object);
      if (found != seen.end() && found->nearest < 0.1) {
        ++reach_past;
        cut += found->u1 - found->u0 < kCamera.width ? 1 : 0;
      }
      for (double v = 0.5; v < kCamera.height; v += 5) {
        for (double u = 0.5; u < kCamera.width; u += 5) {
          const double depth = depth_of_hit(b, ray_at(u, v));
          if (std::isinf(depth)) continue;
          ++hits;
          ASSERT_NE(found, seen.end()) << "seed " << seed << " box " << b.object;
          ASSERT_TRUE(u >= found->u0 && u <= found->u1 && v >= found->v0 && v <= found->v1)
              << "seed " << seed << " box " << b.object << " at " << u << ", " << v;
          ASSERT_GE(depth, found->nearest);
        }
      }
    }
  }
  EXPECT_GT(hits, 100000);
  EXPECT_GT(reach_past, 30);
  EXPECT_GT(cut, reach_past / 2);
}

// The raster is what a search over all boxes gives, block by block.
TEST(Boxes, RasterHoldsTheNearestBox) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Scene scene = random_scene(seed, 40);
    const BoxRaster raster(
        kCamera, boxes_in_view(kCamera, Rigid3(), scene.objects, scene.T_w_o, scene.half));
    for (int y = 0; y < raster.rows(); ++y) {
      for (int x = 0; x < raster.columns(); ++x) {
        const double u = (x + 0.5) * BoxRaster::kBlock;
        const double v = (y + 0.5) * BoxRaster::kBlock;
        auto nearest = std::numeric_limits<float>::infinity();
        std::int32_t object = -1;
        for (const SeenBox& b : scene.all) {
          const auto depth = static_cast<float>(depth_of_hit(b, ray_at(u, v)));
          if (depth >= nearest) continue;
          nearest = depth;
          object = b.object;
        }
        ASSERT_EQ(raster.object_at(u, v), object) << "seed " << seed << " at " << u << ", " << v;
        ASSERT_EQ(raster.depth_at(u, v), nearest);
      }
    }
  }
}

}  // namespace
}  // namespace kys_slam::simulator
