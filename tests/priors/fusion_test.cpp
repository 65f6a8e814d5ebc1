// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>

#include <algorithm>
#include <random>

#include "priors/fusion/drift.h"
#include "priors/fusion/fuse.h"
#include "support/option_walk.h"
#include "synthetic_scene.h"

namespace kys_slam {
namespace {

using synthetic::Box;
using synthetic::depth_of;
using synthetic::inverse_depths;
using synthetic::kitti_camera;
using synthetic::motion;
using synthetic::street;

/// Mean distance (px) of the fitted static flow from the observed one, over stuff.
double static_error(const BuilderOptions& options, const StereoCamera& camera,
                    const CameraPerception& p, double* p95 = nullptr) {
  std::vector<std::uint8_t> stuff(p.panoptic.segments.size() + 1, 0);
  for (std::size_t k = 0; k < p.panoptic.segments.size(); ++k) {
    stuff[k + 1] = !p.panoptic.segments[k].thing;
  }
  const auto fit = fit_ego_motion(options.ego_motion, camera, *p.flow, p.disparity,
                                  depth_of(camera), p.panoptic.map, stuff);
  if (!fit) return 1e9;
  std::vector<double> errors;
  std::vector<float> u(static_cast<std::size_t>(camera.width)), v(u.size());
  for (int y = 0; y < camera.height; y += 3) {
    fit->predict_row(y, inverse_depths(camera, p, y).data(), u.data(), v.data());
    for (int x = 0; x < camera.width; x += 3) {
      if (!stuff[p.panoptic.map.at(x, y)] || !std::isfinite(p.flow->u.at(x, y))) continue;
      errors.push_back(std::hypot(u[static_cast<std::size_t>(x)] - p.flow->u.at(x, y),
                                  v[static_cast<std::size_t>(x)] - p.flow->v.at(x, y)));
    }
  }
  std::sort(errors.begin(), errors.end());
  if (p95 != nullptr) *p95 = errors[errors.size() * 95 / 100];
  double sum = 0;
  for (const double e : errors) sum += e;
  return sum / static_cast<double>(errors.size());
}

/// The instantaneous flow of the Longuet-Higgins model in px, from a small twist.
void make_instantaneous(const StereoCamera& k, const Eigen::Vector3d& w, const Eigen::Vector3d& t,
                        CameraPerception& p) {
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const double rho = depth_of(k)(p.disparity.at(u, v));
      // Centred principal point, as Eq. 6 assumes.
      const double x = (u - 0.5 * k.width) / k.fx, y = (v - 0.5 * k.height) / k.fy;
      const Eigen::Vector3d ray(x, y, 1);
      const Eigen::Vector3d velocity = w.cross(ray) + rho * t;
      p.flow->u.at(u, v) = static_cast<float>(k.fx * (velocity.x() - x * velocity.z()));
      p.flow->v.at(u, v) = static_cast<float>(k.fy * (velocity.y() - y * velocity.z()));
    }
  }
}

BuilderOptions with_model(EgoMotionModel model) {
  BuilderOptions options;
  options.ego_motion.model = model;
  return options;
}

TEST(EgoMotion, RigidSpansInstantaneousFlowAndThePrintedFormDoesNot) {
  const StereoCamera camera = kitti_camera();
  CameraPerception p = street(camera, {}, {});
  const auto rigid = with_model(EgoMotionModel::kRigid);
  const auto printed = with_model(EgoMotionModel::kAsPrinted);
  make_instantaneous(camera, {0.002, 0.01, 0.005}, {0.05, 0.02, -0.9}, p);
  EXPECT_LT(static_error(rigid, camera, p), 1e-3);
  make_instantaneous(camera, {0.01, 0, 0}, {0, 0, -0.9}, p);  // pitch: 0.20 px in method notes
  EXPECT_LT(static_error(rigid, camera, p), 1e-3);
  EXPECT_NEAR(static_error(printed, camera, p), 0.2, 0.15);
  make_instantaneous(camera, {0, 0, 0.01}, {0, 0, -0.9}, p);  // roll: 3.2 px in method notes
  EXPECT_LT(static_error(rigid, camera, p), 1e-3);
  EXPECT_NEAR(static_error(printed, camera, p), 3.2, 1.0);
  // Without roll and pitch the printed form is as good.
  make_instantaneous(camera, {0, 0.01, 0}, {0.1, 0, -0.9}, p);
  EXPECT_LT(static_error(printed, camera, p), 1e-3);
}

TEST(EgoMotion, Se3IsExactOnFiniteMotionAndLinearModelsAreNot) {
  const StereoCamera camera = kitti_camera();
  const Rigid3 T = motion(0.004, 0.02, 0.003, 0.03, -0.02, -1.0);
  const CameraPerception p = street(camera, T, {});
  EXPECT_LT(static_error(with_model(EgoMotionModel::kSe3), camera, p), 2e-3);
  double p95 = 0;
  const double linear = static_error(with_model(EgoMotionModel::kRigid), camera, p, &p95);
  EXPECT_GT(linear, 0.2);
  EXPECT_LT(linear, 1.5);
  EXPECT_GT(p95, 0.8);
}

TEST(EgoMotion, Se3FindsTheMotionUnderOutliersAndNoise) {
  const StereoCamera camera = kitti_camera(620, 188);
  const Rigid3 T = motion(0.004, 0.02, 0.003, 0.03, -0.02, -1.0);
  CameraPerception p = street(camera, T, {});
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.3F);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      p.flow->u.at(x, y) += noise(random) + (random() % 10 == 0 ? 25.0F : 0.0F);
      p.flow->v.at(x, y) += noise(random);
      if (random() % 20 == 0) p.disparity.at(x, y) = kNoValue;
      if (random() % 20 == 0) p.flow->u.at(x, y) = p.flow->v.at(x, y) = kNoValue;
    }
  }
  const std::vector<std::uint8_t> stuff = {0, 1, 1};
  const auto fit =
      fit_ego_motion({}, camera, *p.flow, p.disparity, depth_of(camera), p.panoptic.map, stuff);
  ASSERT_TRUE(fit.has_value());
  EXPECT_LT(minus(fit->T_next_now, T).head<3>().norm(), 1e-3);
  EXPECT_LT((fit->T_next_now.t() - T.t()).norm(), 0.02);
}

TEST(EgoMotion, TheSubsampleMovesTheFieldByLessThanTheAllowedTwoHundredths) {
  const StereoCamera camera = kitti_camera();
  CameraPerception p = street(camera, motion(0.001, 0.01, 0.001, 0, 0, -0.8), {});
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.3F);
  for (std::size_t i = 0; i < p.flow->u.size(); ++i) {
    p.flow->u.data()[i] += noise(random);
    p.flow->v.data()[i] += noise(random);
  }
  const std::vector<std::uint8_t> stuff = {0, 1, 1};
  BuilderOptions::EgoMotion all;
  all.grid_samples = 0;
  const auto a =
      fit_ego_motion({}, camera, *p.flow, p.disparity, depth_of(camera), p.panoptic.map, stuff);
  const auto b =
      fit_ego_motion(all, camera, *p.flow, p.disparity, depth_of(camera), p.panoptic.map, stuff);
  ASSERT_TRUE(a && b);
  std::vector<float> ua(1241), va(1241), ub(1241), vb(1241);
  double sum = 0;
  int count = 0;
  for (int y = 0; y < camera.height; y += 5, ++count) {
    a->predict_row(y, inverse_depths(camera, p, y).data(), ua.data(), va.data());
    b->predict_row(y, inverse_depths(camera, p, y).data(), ub.data(), vb.data());
    double row = 0;
    for (std::size_t x = 0; x < 1241; ++x) row += std::hypot(ua[x] - ub[x], va[x] - vb[x]);
    sum += row / 1241;
  }
  EXPECT_LT(sum / count, 0.02);
}

TEST(EgoMotion, WhereThingsFillTheImageALittleOfTheSceneIsEnough) {
  const StereoCamera camera = kitti_camera(620, 188);
  const Rigid3 T = motion(0.004, 0.02, 0.003, 0.03, -0.02, -1.0);
  // A vehicle before the camera that drives as fast: it hides all but a band.
  const CameraPerception p = street(camera, T, {{10, 0, 560, 188, 6, Eigen::Vector3d(0, 0, 1)}});
  const std::vector<std::uint8_t> stuff = {0, 1, 1, 0};
  BuilderOptions::EgoMotion coarse;
  int visible = 0;
  for (std::size_t i = 0; i < p.panoptic.map.size(); ++i) {
    visible += stuff[p.panoptic.map.data()[i]];
  }
  const auto pixels = static_cast<double>(p.panoptic.map.size());
  coarse.grid_samples = 1000;
  ASSERT_LT(visible * coarse.grid_samples / pixels, coarse.min_samples);
  const auto fit =
      fit_ego_motion(coarse, camera, *p.flow, p.disparity, depth_of(camera), p.panoptic.map, stuff);
  ASSERT_TRUE(fit.has_value());
  EXPECT_GE(fit->samples, coarse.min_samples);
  EXPECT_LT((fit->T_next_now.t() - T.t()).norm(), 0.02);
}

TEST(EgoMotion, TooFewPixelsGiveNoMotion) {
  const StereoCamera camera = kitti_camera(310, 94);
  CameraPerception p = street(camera, motion(0, 0, 0, 0, 0, -1), {});
  const std::vector<std::uint8_t> nothing = {0, 0, 0};
  EXPECT_FALSE(
      fit_ego_motion({}, camera, *p.flow, p.disparity, depth_of(camera), p.panoptic.map, nothing)
          .has_value());
  for (std::size_t i = 0; i < p.flow->u.size(); ++i) p.flow->u.data()[i] = kNoValue;
  p.panoptic.segments[0].thing = false;
  const CameraFusion fusion = fuse_camera({}, camera, p);
  EXPECT_FALSE(fusion.ego_motion.has_value());
  EXPECT_GT(fusion.priors.segments[0].scale, 0.0F);
}

TEST(EgoMotion, AStaticPointThatWouldBeBehindTheCameraHasNoPrediction) {
  EgoMotion motion;
  motion.camera = kitti_camera();
  motion.T_next_now = Rigid3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -1));
  const std::vector<float> rho = [&] {
    std::vector<float> row(static_cast<std::size_t>(motion.camera.width), 1.0F / 0.9F);
    row[700] = 1.0F / 2.0F;
    row[701] = kNoValue;
    return row;
  }();
  std::vector<float> u(rho.size()), v(rho.size());
  motion.predict_row(100, rho.data(), u.data(), v.data());
  EXPECT_TRUE(std::isnan(u[0]) && std::isnan(v[0]));
  EXPECT_TRUE(std::isnan(u[701]) && std::isnan(v[701]));
  // At half the depth everything is twice as far from the principal point.
  EXPECT_NEAR(u[700], 700 - motion.camera.cx, 1e-2);
  EXPECT_NEAR(v[700], 100 - motion.camera.cy, 1e-2);
}

TEST(Residual, SumsAndReferencesAreThoseOfThePixels) {
  // Pure rotation, so that depth plays no part; what is added to the flow comes back as residual.
  const StereoCamera camera = kitti_camera(310, 94);
  const CameraPerception p = street(camera, motion(0, 0.004, 0, 0, 0, 0),
                                    {{100, 40, 153, 70, 10, Eigen::Vector3d(0, 0, 0)}});
  EgoMotion ego;
  ego.camera = camera;
  ego.T_next_now = motion(0, 0.004, 0, 0, 0, 0);
  FlowField flow = *p.flow;
  for (int y = 40; y < 70; ++y) {
    for (int x = 100; x < 153; ++x) flow.v.at(x, y) += x % 2 == 0 ? 3.0F : 5.0F;
  }
  for (int y = 0; y < 10; ++y) flow.u.at(5, y) = flow.v.at(5, y) = kNoValue;
  const SegmentRuns runs = find_runs(p.panoptic.map);
  const std::vector<std::uint8_t> is_stuff = {0, 1, 1, 0};
  BuilderOptions::Drift options;
  options.enabled = false;
  ResidualField field(options, ego, flow, p.disparity, depth_of(camera), runs);
  field.add_to_drift(is_stuff);
  field.smooth_drift();
  std::vector<SegmentSums> sums(4);
  const ImageOf<float> lengths = field.add_to_segments(is_stuff, sums);
  EXPECT_EQ(sums[3].flow_count, 53u * 30u);
  EXPECT_EQ(sums[3].depth_count, 53u * 30u);
  EXPECT_NEAR(sums[3].residual, 30 * (27 * 3 + 26 * 5), 0.05);
  EXPECT_NEAR(sums[3].depth, 53 * 30 * 10.0, 0.1);
  EXPECT_EQ(sums[1].flow_count + sums[2].flow_count, 310u * 94u - 53u * 30u - 10u);
  EXPECT_NEAR(lengths.at(100, 40), 3, 1e-3);
  EXPECT_NEAR(lengths.at(101, 69), 5, 1e-3);
  const FusionImages images = field.images();
  EXPECT_TRUE(std::isnan(images.corrected.at(5, 3)));
  EXPECT_NEAR(images.corrected.at(152, 50), 3, 1e-3);
  EXPECT_NEAR(images.residual.v.at(101, 50), 5, 1e-3);
  EXPECT_EQ(images.drift.u.at(101, 50), 0);
  double radial = 0, radial_squared = 0;
  for (int y = 40; y < 70; ++y) {
    for (int x = 100; x < 153; ++x) {
      const Eigen::Vector2d predicted(images.predicted.u.at(x, y), images.predicted.v.at(x, y));
      const Eigen::Vector2d residual(images.residual.u.at(x, y), images.residual.v.at(x, y));
      const double along = residual.dot(predicted.normalized());
      radial += along;
      radial_squared += along * along;
    }
  }
  EXPECT_GT(radial_squared, 1);
  EXPECT_NEAR(sums[3].radial, radial, 0.01);
  EXPECT_NEAR(sums[3].radial_squared, radial_squared, 0.01);
  // Outliers in the background move its moments, not its medians.
  for (int y = 80; y < 94; ++y) {
    for (int x = 0; x < 100; ++x) flow.v.at(x, y) += 40;
  }
  const BackgroundReferences robust = field.robust_references(p.panoptic.map, is_stuff);
  EXPECT_LT(robust.m_bg, 1e-3);
  EXPECT_LT(robust.sigma_par, 1e-3);
  EXPECT_GT(robust.pixels, 1000);
}

TEST(Panoptic, RunsCoverEveryRow) {
  std::mt19937 random(4);
  ImageOf<std::uint16_t> map(101, 40);
  for (std::size_t i = 0; i < map.size(); ++i) {
    const bool stays = i % 101 != 0 && random() % 5 != 0;
    map.data()[i] = stays ? map.data()[i - 1] : static_cast<std::uint16_t>(random() % 3);
  }
  const SegmentRuns runs = find_runs(map);
  for (int y = 0; y < map.height(); ++y) {
    int x = 0;
    for (const SegmentRun& run : runs.row(y)) {
      ASSERT_EQ(run.x0, x);
      ASSERT_GT(run.x1, run.x0);
      for (; x < run.x1; ++x) ASSERT_EQ(map.at(x, y), run.segment);
      ASSERT_TRUE(x == map.width() || map.at(x, y) != run.segment);
    }
    ASSERT_EQ(x, map.width());
  }
}

/// The drift field at full size, straight from its definition.
double exact_drift(const ImageOf<float>& r, double sigma, int u, int v) {
  double sum = 0, weight = 0;
  const auto reflect = [](int i, int n) {
    i = ((i % (2 * n)) + 2 * n) % (2 * n);
    return i < n ? i : 2 * n - 1 - i;
  };
  const int radius = static_cast<int>(4 * sigma);
  for (int dy = -radius; dy <= radius; ++dy) {
    for (int dx = -radius; dx <= radius; ++dx) {
      const float value = r.at(reflect(u + dx, r.width()), reflect(v + dy, r.height()));
      if (!std::isfinite(value)) continue;
      const double w = std::exp(-0.5 * (dx * dx + dy * dy) / (sigma * sigma));
      sum += w * value;
      weight += w;
    }
  }
  return sum / weight;
}

TEST(Drift, AgreesWithTheFullSizeGaussian) {
  const int width = 317, height = 150;  // not multiples of the cell
  ImageOf<float> r(width, height), zero(width, height);
  std::mt19937 random(3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool hole = (x > 100 && x < 180 && y > 40 && y < 110) || random() % 7 == 0;
      r.at(x, y) =
          hole ? kNoValue
               : static_cast<float>(std::sin(0.02 * x) + 0.01 * y + 0.5 * (random() % 1000) * 1e-3);
    }
  }
  BuilderOptions::Drift options;
  DriftField drift(options, width, height);
  for (int y = 0; y < height; ++y) {
    if (!drift.uses(y)) continue;
    const DriftField::Columns sums = drift.columns(y);
    for (int x = 0; x < width; ++x) {
      if (std::isnan(r.at(x, y))) continue;
      sums.u[x] += r.at(x, y);
      sums.v[x] -= r.at(x, y);
      sums.count[x] += 1;
    }
  }
  drift.smooth();
  double worst = 0;
  for (int y : {0, 37, 75, 149}) {
    for (int x : {0, 3, 140, 200, 316}) {
      float u = 0, v = 0, coverage = 0;
      drift.row(y).at(x, u, v, coverage);
      worst = std::max(worst, std::abs(exact_drift(r, options.sigma, x, y) - u));
      EXPECT_NEAR(u, -v, 1e-6);
    }
  }
  EXPECT_LT(worst, 0.02);  // of a field with values up to 2.5 px
  RecordProperty("worst_px", std::to_string(worst));
}

TEST(Drift, CoverageIsOneOverFullStuff) {
  for (const int cell : {1, 5, 8}) {
    BuilderOptions::Drift options;
    options.cell = cell;
    DriftField drift(options, 100, 60);
    for (int y = 0; y < 60; ++y) {
      if (!drift.uses(y)) continue;
      const DriftField::Columns sums = drift.columns(y);
      for (float* sum : {sums.u, sums.v, sums.count}) {
        for (int x = 0; x < 100; ++x) sum[x] += 1;
      }
    }
    drift.smooth();
    for (int x = 0; x < 100; ++x) {
      float u = 0, v = 0, coverage = 0;
      drift.row(59).at(x, u, v, coverage);
      EXPECT_NEAR(coverage, 1.0F, 1e-4);
      EXPECT_NEAR(u, 1.0F, 1e-4);
      EXPECT_NEAR(v, 1.0F, 1e-4);
    }
  }
}

TEST(Detection, FormulasByHand) {
  const BuilderOptions o;
  EXPECT_DOUBLE_EQ(coverage_scale(o.detection, 0.15), 4.0);
  EXPECT_DOUBLE_EQ(coverage_scale(o.detection, 0.3), 2.5);
  EXPECT_DOUBLE_EQ(coverage_scale(o.detection, 0.95), 1.0);
  BackgroundReferences bg;
  bg.m_bg = 0.5;
  bg.mu_par = 0.2;
  bg.sigma_par = 0.4;
  EXPECT_DOUBLE_EQ(rotation_guard(o.detection, bg), 1.0);
  bg.mu_par = -0.6;
  EXPECT_DOUBLE_EQ(rotation_guard(o.detection, bg), 3.0);
  bg.mu_par = 4;
  EXPECT_DOUBLE_EQ(rotation_guard(o.detection, bg), 5.0);
  EXPECT_DOUBLE_EQ(residual_ratio(60, 0.5), 100.0);
  EXPECT_DOUBLE_EQ(residual_ratio(2, 0.5), 4.0);
  // 5 ln^2(5) = 12.9513...; rho = 100 saturates: 5 ln^2(101) = 106.5 -> 100.
  EXPECT_NEAR(motion_score(o.score, 4), 12.95145, 1e-5);
  EXPECT_DOUBLE_EQ(motion_score(o.score, 100), 100.0);
  EXPECT_DOUBLE_EQ(motion_score(o.score, 0), 0.0);
}

TEST(Detection, RulesOfEquation7) {
  const BuilderOptions o;
  BackgroundReferences bg;
  bg.m_bg = 0.5;
  bg.mu_par = 0.1;
  bg.sigma_par = 0.4;
  SegmentStatistics s;
  s.area = s.flow_count = 1000;
  s.coverage = 0.9;  // omega = 1
  s.residual = 0.99;
  s.radial = 0.1;
  EXPECT_FALSE(decide(o, s, bg).dynamic);
  s.residual = 1.01;  // over 2 m_bg
  EXPECT_TRUE(decide(o, s, bg).dynamic);
  EXPECT_FALSE(decide(o, s, bg).radial_only);
  s.coverage = 0.3;  // omega = 2.5
  EXPECT_FALSE(decide(o, s, bg).dynamic);
  s.residual = 0.9;
  s.coverage = 0.9;
  s.radial = 0.1 + 0.81;  // over 2 sigma
  EXPECT_TRUE(decide(o, s, bg).radial_only);
  s.coverage = 0.29;  // no radial test
  EXPECT_FALSE(decide(o, s, bg).dynamic);
  s.coverage = 0.049;  // no context: omega = 4, ten times as hard: 40 px
  s.residual = 39;
  EXPECT_FALSE(decide(o, s, bg).dynamic);
  s.residual = 41;
  EXPECT_TRUE(decide(o, s, bg).dynamic);
  EXPECT_FALSE(decide(paper_options(), s, bg).dynamic);  // the paper: static
}

TEST(Scale, IsAreaTimesSquaredDepth) {
  SegmentStatistics s;
  s.area = 200;
  EXPECT_EQ(depth_compensated_scale(s), 0.0F);
  s.depth_count = 50;
  s.mean_depth = 10;
  EXPECT_FLOAT_EQ(depth_compensated_scale(s), 20000.0F);
}

TEST(Depth, InverseDepthCapsAndRefuses) {
  const InverseDepth inverse_depth(386.0, 255.0);
  EXPECT_FLOAT_EQ(inverse_depth(10), 10.0F / 386.0F);
  EXPECT_FLOAT_EQ(inverse_depth(1e-3F), 1.0F / 255.0F);
  EXPECT_TRUE(std::isnan(inverse_depth(0)));
  EXPECT_TRUE(std::isnan(inverse_depth(-1)));
  EXPECT_TRUE(std::isnan(inverse_depth(kNoValue)));
}

TEST(Depth, NearestSurfaceWinsInTheRightView) {
  ImageOf<float> left(10, 1, kNoValue);
  left.at(5, 0) = 2;  // to 3
  left.at(8, 0) = 5;  // to 3, nearer
  left.at(9, 0) = 2;  // to 7
  left.at(1, 0) = 4;  // outside
  const ImageOf<float> right = warp_disparity_to_right(left);
  EXPECT_EQ(right.at(3, 0), 5.0F);
  EXPECT_EQ(right.at(7, 0), 2.0F);
  EXPECT_TRUE(std::isnan(right.at(0, 0)));
  ImageOf<float> checked = left;
  check_left_right(checked, right, -1, 1.0);
  EXPECT_TRUE(std::isnan(checked.at(5, 0)));  // hidden in the right view
  EXPECT_EQ(checked.at(8, 0), 5.0F);
}

TEST(Depth, WarpingClosesGapsAndHeedsClasses) {
  // A near wall with a hole of 2 px at 4 and 5, through which a far surface shows.
  ImageOf<float> left(20, 1, kNoValue);
  for (int x = 8; x < 18; ++x) {
    if (x != 12 && x != 13) left.at(x, 0) = 8;  // to 0..3 and 6..9
  }
  left.at(5, 0) = 1;   // to 4
  left.at(6, 0) = 1;   // to 5
  left.at(19, 0) = 2;  // to 17: in the open
  const ImageOf<float> right = warp_disparity_to_right(left);
  EXPECT_EQ(right.at(3, 0), 8.0F);
  EXPECT_TRUE(std::isnan(right.at(4, 0)));
  EXPECT_TRUE(std::isnan(right.at(5, 0)));
  EXPECT_EQ(right.at(17, 0), 2.0F);
  // What is of another class in the right view is hidden there.
  ImageOf<std::uint16_t> left_map(20, 1, 1), right_map(20, 1, 1);
  const ClassImage left_classes{&left_map, {0xFFFF, 7, 3}},
      right_classes{&right_map, {0xFFFF, 7, 3}};
  left_map.at(19, 0) = 2;
  const ImageOf<float> labelled = warp_disparity_to_right(left, &left_classes, &right_classes);
  EXPECT_EQ(labelled.at(3, 0), 8.0F);
  EXPECT_EQ(labelled.at(4, 0), 8.0F);  // all one class: the wall goes on
  right_map.at(4, 0) = 2;
  EXPECT_TRUE(std::isnan(warp_disparity_to_right(left, &left_classes, &right_classes).at(4, 0)));
  EXPECT_TRUE(std::isnan(labelled.at(17, 0)));
}

TEST(Depth, WhatIsBehindTheSurfaceAtTheBorderIsNotSeenInTheRightView) {
  // A near car goes on beyond the left view; the right view sees more of it, before a farther car
  // that the left view sees beside it.
  ImageOf<float> left(20, 1, kNoValue);
  for (int x = 14; x < 20; ++x) left.at(x, 0) = 8;  // to 6..11
  left.at(13, 0) = 1;                               // to 12, where the near car is
  left.at(3, 0) = 1;                                // to 2
  const ImageOf<float> right = warp_disparity_to_right(left);
  EXPECT_EQ(right.at(11, 0), 8.0F);
  EXPECT_TRUE(std::isnan(right.at(12, 0)));
  EXPECT_EQ(right.at(2, 0), 1.0F);
  // Of another class than the car, it is beside it in the right view as well.
  ImageOf<std::uint16_t> left_map(20, 1, 1);
  for (int x = 14; x < 20; ++x) left_map.at(x, 0) = 2;
  const ImageOf<std::uint16_t> right_map(20, 1, 1);
  const ClassImage left_classes{&left_map, {0xFFFF, 3, 7}},
      right_classes{&right_map, {0xFFFF, 3, 7}};
  EXPECT_EQ(warp_disparity_to_right(left, &left_classes, &right_classes).at(12, 0), 1.0F);
}

TEST(FlowCheck, KeepsConsistentFlowOnly) {
  FlowField forward{ImageOf<float>(20, 4, 3.0F), ImageOf<float>(20, 4, 0.0F)};
  FlowField backward{ImageOf<float>(20, 4, -3.5F), ImageOf<float>(20, 4, 0.0F)};
  for (int x = 8; x < 20; ++x) backward.u.at(x, 0) = 9;
  check_forward_backward(forward, backward, 1, 0.02);
  EXPECT_EQ(forward.u.at(2, 0), 3.0F);
  EXPECT_TRUE(std::isnan(forward.u.at(6, 0)));   // contradicted
  EXPECT_TRUE(std::isnan(forward.u.at(18, 1)));  // leaves the image
}

TEST(Fusion, FlagsMoversAndLeavesParkedCarsAlone) {
  const StereoCamera camera = kitti_camera();
  const std::vector<Box> boxes = {{300, 190, 380, 240, 15, {0.5, 0, 0}},  // crosses
                                  {700, 185, 760, 225, 20, {0, 0, 1.0}},  // drives ahead
                                  {850, 190, 930, 240, 14, {0, 0, 0}},    // parked
                                  {450, 185, 490, 215, 25, {0, 0, 0}}};   // parked
  for (const EgoMotionModel model : {EgoMotionModel::kSe3, EgoMotionModel::kRigid}) {
    const CameraPerception p = street(camera, motion(0, 0.005, 0, 0, 0, -0.9), boxes);
    const CameraFusion fusion = fuse_camera(with_model(model), camera, p);
    ASSERT_TRUE(fusion.ego_motion.has_value());
    const auto& segments = fusion.priors.segments;
    ASSERT_EQ(segments.size(), 6u);
    EXPECT_EQ(segments[0].flags, 0);
    EXPECT_TRUE(segments[2].flags & prior_format::kDynamic);
    EXPECT_TRUE(segments[3].flags & prior_format::kDynamic);
    EXPECT_FALSE(segments[4].flags & prior_format::kDynamic) << static_cast<int>(model);
    EXPECT_FALSE(segments[5].flags & prior_format::kDynamic) << static_cast<int>(model);
    EXPECT_NEAR(segments[4].scale, 80 * 50 * 14.0 * 14.0, 1.0);
    EXPECT_GT(segments[2].score, 20.0F);
    // The crossing car moves 0.5 m at 15 m, seen from 0.9 m nearer: about 25 px.
    EXPECT_NEAR(fusion.statistics[2].residual, 0.5 * camera.fx / 14.1, 3.0);
    EXPECT_GT(fusion.priors.motion.at(340, 215), 20.0F);
  }
}

TEST(Fusion, AScoreOfZeroIsExportedAsZero) {
  const StereoCamera camera = kitti_camera();
  const CameraPerception p =
      street(camera, motion(0, 0.005, 0, 0, 0, -0.9), {{300, 190, 380, 240, 15, {0.5, 0, 0}}});
  BuilderOptions no_factor, no_maximum;
  no_factor.score.factor = 0;
  no_maximum.score.maximum = 0;
  for (const BuilderOptions& options : {no_factor, no_maximum}) {
    const CameraFusion fusion = fuse_camera(options, camera, p);
    ASSERT_TRUE(fusion.priors.segments[2].flags & prior_format::kDynamic);
    ASSERT_FALSE(fusion.priors.segments[2].flags & prior_format::kRadialOnly);
    for (int y = 190; y < 240; ++y) {
      for (int x = 300; x < 380; ++x) ASSERT_EQ(fusion.priors.motion.at(x, y), 0.0F);
    }
  }
}

TEST(Fusion, WithoutFlowNothingMovesAndScaleStays) {
  const StereoCamera camera = kitti_camera(310, 94);
  CameraPerception p =
      street(camera, motion(0, 0, 0, 0, 0, -1), {{100, 50, 150, 80, 10, Eigen::Vector3d(1, 0, 0)}});
  p.flow.reset();
  const CameraFusion fusion = fuse_camera({}, camera, p);
  for (const PriorSegment& s : fusion.priors.segments) {
    EXPECT_EQ(s.flags & prior_format::kDynamic, 0);
    EXPECT_GT(s.scale, 0.0F);
  }
  EXPECT_NEAR(fusion.priors.segments[2].scale, 50 * 30 * 100.0, 1.0);
}

TEST(Options, EveryNameIsSettableAndRefusesNonsense) {
  BuilderOptions options;
  set_option(options, "ego_motion.model", "as_printed");
  set_option(options, "detection.references", "robust");
  set_option(options, "drift.sigma", "45.5");
  set_option(options, "association.class_agnostic", "true");
  EXPECT_EQ(options.ego_motion.model, EgoMotionModel::kAsPrinted);
  EXPECT_DOUBLE_EQ(options.drift.sigma, 45.5);
  EXPECT_NE(to_text(options).find("detection.references: robust"), std::string::npos);
  EXPECT_THROW(set_option(options, "drift.sigma", "nan"), InputError);
  EXPECT_THROW(set_option(options, "drift.sigma", "4x"), InputError);
  EXPECT_THROW(set_option(options, "drift.sigmas", "4"), InputError);
  EXPECT_THROW(set_option(options, "ego_motion.model", "best"), InputError);
  options.drift.cell = 0;
  EXPECT_THROW(options.check(), InputError);
}

TEST(Options, EveryNumberIsChecked) {
  // Its fields are sections of fields.
  using B = BuilderOptions;
  using test::field_count;
  EXPECT_EQ(test::listed<B>(), field_count<B::Association>() + field_count<B::Segments>() +
                                   field_count<B::Depth>() + field_count<B::FlowCheck>() +
                                   field_count<B::FlowEstimate>() + field_count<B::EgoMotion>() +
                                   field_count<B::Drift>() + field_count<B::Detection>() +
                                   field_count<B::Keypoints>() + field_count<B::Score>() +
                                   field_count<B::Export>());
  test::expect_numbers_checked(B());
  test::expect_numbers_checked(paper_options());
  BuilderOptions options;
  options.detection.start_log_odds = 5.5;
  EXPECT_EQ(test::complaint(options),
            "detection.start_log_odds must not be beyond detection.max_log_odds");
}

}  // namespace
}  // namespace kys_slam
