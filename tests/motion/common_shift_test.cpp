// SPDX-License-Identifier: BSD-3-Clause
#include "motion/common_shift.h"

#include <gtest/gtest.h>

#include <random>
#include <utility>
#include <vector>

namespace kys_slam {
namespace {

const StereoCamera kSmallCamera{620, 188, 360, 360, 305, 92, 0.54};
constexpr CommonShiftOptions kOptions{.max_distance = 80, .min_count = 4};
constexpr double kPeriod = 0.9;  // m, after which the side of a bus looks the same again

/// The side of a bus that comes nearer: `columns` windows in a row, alike to the last bit.
struct Bus {
  explicit Bus(int columns) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> inside(0, kPeriod);
    std::uniform_real_distribution<double> height(-1.2, 1);
    for (int k = 0; k < 10; ++k) {
      kys::Descriptor descriptor;
      for (std::uint64_t& word : descriptor.words) word = random();
      const Eigen::Vector3d corner(-3.4, height(random), 10 + inside(random));
      for (int c = 0; c < columns; ++c) {
        points.push_back(corner + Eigen::Vector3d(0, 0, c * kPeriod));
        descriptors.push_back(descriptor);
      }
    }
  }

  /// Its keypoints after it went `shift`, with noise of 0.3 px.
  [[nodiscard]] FrameFeatures seen(const Eigen::Vector3d& shift) const {
    std::mt19937 random(9);
    std::normal_distribution<float> noise(0, 0.3F);
    FeatureSet set;
    std::vector<float> u_right;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d pixel = kSmallCamera.project_stereo(points[i] + shift);
      Keypoint k;
      k.x = static_cast<float>(pixel.x()) + noise(random);
      k.y = static_cast<float>(pixel.y()) + noise(random);
      set.keypoints.push_back(k);
      set.descriptors.push_back(descriptors[i]);
      u_right.push_back(static_cast<float>(pixel.z()) + noise(random));
    }
    return {kSmallCamera, std::move(set), std::move(u_right), {}};
  }

  [[nodiscard]] std::vector<UnknownPlace> places(const FrameFeatures& before) const {
    std::vector<UnknownPlace> list;
    for (std::size_t i = 0; i < points.size(); ++i) {
      UnknownPlace place{
          i, points[i],
          query_for_feature(before, i, kSmallCamera.project_stereo(points[i]), scales)};
      place.query.radius = 60;
      list.push_back(place);
    }
    return list;
  }

  ScaleLevels scales{1.2, 8};
  std::vector<Eigen::Vector3d> points;  // m, where they were
  std::vector<kys::Descriptor> descriptors;
};

TEST(CommonShift, WhatRepeatsItselfIsFollowedAsAWhole) {
  const Bus bus(4);
  const Eigen::Vector3d shift(0, 0, -1.6);
  const FrameFeatures before = bus.seen(Eigen::Vector3d::Zero());
  const FrameFeatures now = bus.seen(shift);
  const std::vector<UnknownPlace> places = bus.places(before);
  kys::Statistics statistics;
  const kys::DistanceModel model;

  // One by one, nearly all are ambiguous or wrong.
  std::vector<SearchQuery> queries;
  for (const UnknownPlace& place : places) queries.push_back(place.query);
  SearchOptions search;
  search.ratio = 0.85F;
  int right = 0;
  const auto matches = search_features(now, bus.scales, queries, search, model, statistics);
  for (std::size_t q = 0; q < matches.size(); ++q) {
    right += matches[q].feature == static_cast<std::int32_t>(q) ? 1 : 0;
  }
  EXPECT_LT(right, static_cast<int>(places.size()) / 4);

  const auto common =
      common_shift(kSmallCamera, bus.scales, now, places, kOptions, model, statistics);
  ASSERT_TRUE(common);
  EXPECT_LT((*common - shift).norm(), 0.4 * kPeriod) << common->transpose();
}

TEST(CommonShift, NothingInCommonIsNoShift) {
  const Bus bus(3);
  const FrameFeatures before = bus.seen(Eigen::Vector3d::Zero());
  // Every point goes its own way.
  std::mt19937 random(3);
  std::uniform_real_distribution<double> way(-0.8, 0.8);
  Bus scattered = bus;
  for (Eigen::Vector3d& p : scattered.points) {
    p += Eigen::Vector3d(way(random), way(random), way(random));
  }
  kys::Statistics statistics;
  EXPECT_FALSE(common_shift(kSmallCamera, bus.scales, scattered.seen(Eigen::Vector3d::Zero()),
                            bus.places(before), kOptions, kys::DistanceModel(), statistics));
  EXPECT_FALSE(common_shift(kSmallCamera, bus.scales, before, {}, kOptions, kys::DistanceModel(),
                            statistics));
}

}  // namespace
}  // namespace kys_slam
