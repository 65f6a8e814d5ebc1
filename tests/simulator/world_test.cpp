// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/world.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cmath>

#include "simulator/common/coco_classes.h"
#include "simulator/images/object_truth.h"
#include "simulator/images/renderer.h"
#include "simulator/images/segments.h"
#include "simulator/images/sequence_writer.h"
#include "simulator/worlds/path.h"
#include "support/option_walk.h"

namespace kys_slam::simulator {
namespace {

std::vector<double> speeds(const World& world) {
  std::vector<double> v;
  for (std::size_t i = 1; i < world.times.size(); ++i) {
    v.push_back((world.T_w_c[i].t() - world.T_w_c[i - 1].t()).norm() /
                (world.times[i] - world.times[i - 1]));
  }
  return v;
}

TEST(Path, TurnsEndOnTheLineOfTheNextCorner) {
  const Path path({{0, 0}, {50, 0}, {50, 60}}, 9);
  EXPECT_NEAR(path.position(path.length()).x(), 50, 0.02);
  EXPECT_NEAR(path.position(path.length()).y(), 60, 0.1);
  EXPECT_NEAR(path.heading(path.length()), std::acos(0.0), 1e-3);
  for (double s = 0; s < path.length(); s += 0.5) {
    EXPECT_LE(std::abs(path.curvature(s)), 1.02 / 9) << s;
    EXPECT_NEAR((path.position(s + 0.5) - path.position(s)).norm(), 0.5, 1e-3);
  }
}

TEST(Street, DrivesAsAsked) {
  const World world = make_world({"street", 1});
  ASSERT_EQ(world.times.size(), 200U);
  for (const double v : speeds(world)) {
    EXPECT_GE(v, 5.0);
    EXPECT_LE(v, 12.0);
  }
  const double turn =
      rotation_angle(world.T_w_c.front().inverse() * world.T_w_c.back()) * 180 / std::acos(-1.0);
  EXPECT_GE(turn, 60);
  EXPECT_LE(turn, 90);
  EXPECT_NEAR(world.times[1] - world.times[0], 0.1, 1e-12);
  EXPECT_EQ(world.rectified.width, 1241);
  EXPECT_NEAR(world.rectified.fx, 718.856, 1e-9);
  EXPECT_NEAR(world.rectified.bf(), 386.1448, 1e-6);
}

TEST(Street, CalibrationScalesWithTheImage) {
  WorldOptions options{"street", 1, 2, 620, 188};
  const World world = make_world(options);
  EXPECT_NEAR(world.rectified.fx / 718.856, 620.0 / 1241, 1e-9);
  EXPECT_EQ(world.rectified.fx, world.rectified.fy);
  EXPECT_NEAR((world.rectified.cx + 0.5) / 620, (607.1928 + 0.5) / 1241, 1e-9);
}

TEST(Block, ComesBackAndOverlaps) {
  const World world = make_world({"block", 1});
  const std::size_t count = world.times.size();
  std::size_t back = 0;
  for (std::size_t i = count / 2; i < count && back == 0; ++i) {
    if ((world.T_w_c[i].t() - world.T_w_c[0].t()).norm() < 1.0) back = i;
  }
  ASSERT_GT(back, 0U);
  double overlap = 0;
  for (std::size_t i = back; i + 1 < count; ++i) {
    overlap += (world.T_w_c[i + 1].t() - world.T_w_c[i].t()).norm();
    // It drives where it drove before.
    double nearest = 1e9;
    for (std::size_t j = 0; j < back / 2; ++j) {
      nearest = std::min(nearest, (world.T_w_c[i].t() - world.T_w_c[j].t()).norm());
    }
    EXPECT_LT(nearest, 0.6);
  }
  EXPECT_GE(overlap, 25);
}

// Share of the left image's pixels that movers fill, and the share of the truck ahead.
TEST(Street, MoversFillTheView) {
  const World world = make_world({"street", 1, 0, 206, 62});
  const RenderAssets assets(world);
  FrameRenderer renderer(assets);
  double share = 0;
  int count = 0;
  int truck_frames = 0;
  for (int frame = 0; frame < 200; frame += 8, ++count) {
    const std::vector<bool> moving = moving_objects(world, frame);
    const Panoptic p = make_panoptic(world, renderer.truth(frame, 0), frame, 0, moving);
    double truck = 0;
    for (const Segment& s : p.segments) {
      if (s.moving) share += static_cast<double>(s.area) / (206 * 62);
      if (s.moving && s.category == kTruck) truck = std::max(truck, s.area / (206.0 * 62));
    }
    if (frame < 100 && truck > 0.1) ++truck_frames;
  }
  EXPECT_GE(share / count, 0.12);
  EXPECT_GE(truck_frames, 11) << "the truck ahead is close in the first half";
}

/// Mean shares of the left image over every `step`-th frame.
CoveredShare mean_share(const World& world, int step) {
  const RenderAssets assets(world);
  FrameRenderer renderer(assets);
  CoveredShare mean;
  int count = 0;
  const int frames = static_cast<int>(world.times.size());
  for (int frame = 0; frame < frames; frame += step, ++count) {
    const Panoptic p =
        make_panoptic(world, renderer.truth(frame, 0), frame, 0, moving_objects(world, frame));
    const CoveredShare share = covered_share(world, p);
    mean.moving += share.moving;
    mean.standing += share.standing;
  }
  mean.moving /= count;
  mean.standing /= count;
  return mean;
}

TEST(Traffic, MoversCoverHalfOfTheView) {
  for (const std::uint64_t seed : {1, 2, 11}) {
    const CoveredShare share = mean_share(make_world({"traffic", seed, 100, 206, 62}), 9);
    EXPECT_GE(share.moving, 0.40) << seed;
    EXPECT_LE(share.moving, 0.80) << seed;
    EXPECT_EQ(share.standing, 0.0) << seed;
  }
}

TEST(Jam, StandingVehiclesCoverMostOfTheViewAndSomeStart) {
  for (const std::uint64_t seed : {1, 2, 11}) {
    const World world = make_world({"jam", seed, 100, 206, 62});
    const CoveredShare share = mean_share(world, 9);
    EXPECT_GE(share.standing, 0.50) << seed;
    EXPECT_LE(share.standing, 0.80) << seed;
    const std::vector<bool> first = moving_objects(world, 0);
    int started = 0;
    for (int frame = 10; frame < 100; frame += 10) {
      const std::vector<bool> moving = moving_objects(world, frame);
      for (std::size_t i = 0; i < moving.size(); ++i) {
        const int category = world.scene.objects[i].category;
        started += !first[i] && moving[i] && category != kPerson ? 1 : 0;
      }
    }
    EXPECT_GE(started, 3) << seed;
  }
}

TEST(TrafficAndJam, VehiclesOfALaneDoNotTouch) {
  for (const char* name : {"traffic", "jam"}) {
    const World world = make_world({name, 4, 100, 206, 62});
    const ObjectTruth truth(world);
    for (const int frame : {0, 30, 60, 99}) {
      const auto rows = truth.rows(frame);
      for (std::size_t i = 0; i < rows.size(); ++i) {
        for (std::size_t j = i + 1; j < rows.size(); ++j) {
          if (world.scene.objects[static_cast<std::size_t>(rows[i].object)].category == kPerson ||
              world.scene.objects[static_cast<std::size_t>(rows[j].object)].category == kPerson) {
            continue;
          }
          const Eigen::Vector3d between =
              rows[i].T_g_o.rotation.conjugate() * (rows[j].T_g_o.t() - rows[i].T_g_o.t());
          Eigen::Vector3d room = (rows[i].box.sizes() + rows[j].box.sizes()) / 2;
          room.y() -= 0.25;  // mirrors
          EXPECT_TRUE(std::abs(between.x()) > room.x() || std::abs(between.y()) > room.y())
              << name << " frame " << frame << ": " << rows[i].object << ", " << rows[j].object;
        }
      }
      // The camera is in none of them either.
      for (const auto& row : rows) {
        const Eigen::Vector3d c =
            row.T_g_o.inverse() *
            (world.T_w_c.front().inverse() * world.T_w_c[static_cast<std::size_t>(frame)]).t();
        EXPECT_FALSE(row.box.contains(c)) << name << " frame " << frame << ": " << row.object;
      }
    }
  }
}

// In the first frame too: vehicles that follow the camera's drive have a velocity there.
TEST(ObjectTruthRows, VelocityIsThatOfThePoses) {
  for (const char* name : {"street", "traffic", "jam"}) {
    const World world = make_world({name, 4, 20, 206, 62});
    const ObjectTruth truth(world);
    const double dt = world.times[1] - world.times[0];
    for (int frame = 0; frame < 19; ++frame) {
      const auto now = truth.rows(frame), next = truth.rows(frame + 1);
      ASSERT_EQ(now.size(), next.size());
      for (std::size_t i = 0; i < now.size(); ++i) {
        const Eigen::Vector3d mean = 0.5 * (now[i].velocity + next[i].velocity);
        const Eigen::Vector3d moved = (next[i].T_g_o.t() - now[i].T_g_o.t()) / dt;
        EXPECT_LT((mean - moved).norm(), 0.2) << name << " " << frame << " " << now[i].object;
      }
    }
  }
}

// FAST-9: nine neighbours in a row on the circle of radius 3, all brighter or all darker.
bool is_fast_corner(const GrayImage& image, int x, int y, int threshold) {
  static constexpr int kX[16] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
  static constexpr int kY[16] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};
  const int centre = image.at(x, y);
  int brighter = 0;
  int darker = 0;
  for (int i = 0; i < 16 + 8; ++i) {
    const int d = image.at(x + kX[i % 16], y + kY[i % 16]) - centre;
    brighter = d > threshold ? brighter + 1 : 0;
    darker = d < -threshold ? darker + 1 : 0;
    if (brighter >= 9 || darker >= 9) return true;
  }
  return false;
}

bool cell_has_corner(const GrayImage& image, int x0, int y0, int threshold) {
  for (int y = std::max(3, y0); y < std::min(image.height() - 3, y0 + 30); ++y) {
    for (int x = std::max(3, x0); x < std::min(image.width() - 3, x0 + 30); ++x) {
      if (is_fast_corner(image, x, y, threshold)) return true;
    }
  }
  return false;
}

TEST(Street, NearlyEveryCellHoldsACorner) {
  const World world = make_world({"street", 1});
  const RenderAssets assets(world);
  FrameRenderer renderer(assets);
  int cells = 0;
  int with_corner = 0;
  for (const int frame : {10, 70, 105, 140, 175}) {
    const GrayImage image = renderer.image(frame, 0);
    for (int y = 0; y + 30 <= image.height(); y += 30) {
      for (int x = 0; x + 30 <= image.width(); x += 30) {
        ++cells;
        if (cell_has_corner(image, x, y, 20) || cell_has_corner(image, x, y, 7)) ++with_corner;
      }
    }
  }
  RecordProperty("share", std::to_string(static_cast<double>(with_corner) / cells));
  EXPECT_GE(static_cast<double>(with_corner) / cells, 0.90);
}

TEST(Worlds, EveryNumberOfTheirOptionsIsChecked) {
  kys_slam::test::expect_every_number_checked<WorldOptions>(1);  // the name, the seed; blur is two
  // Folder, command, truth, quiet, stop.
  kys_slam::test::expect_every_number_checked<WriteOptions>(5);
}

TEST(Worlds, BadRequestsAreRefused) {
  EXPECT_THROW(make_world({"street", 1, 0, 10, 10}), InputError);
  EXPECT_THROW(make_world({"street", 1, 0, 100000, 376}), InputError);
  EXPECT_THROW(make_world({"street", 1, -5}), InputError);
  EXPECT_THROW(make_world({"street", 1, 1000000}), InputError);
  try {
    make_world({"stret", 1});
    FAIL() << "an unknown world was accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("'street'"), std::string::npos);
  }
}

}  // namespace
}  // namespace kys_slam::simulator
