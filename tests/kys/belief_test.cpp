// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/kys.h>

#include <string>

namespace kys::test {
namespace {

TEST(Belief, WhatCanMove) {
  const LabelSpace coco = load_label_space("coco_panoptic_133");
  const auto of = [&](const char* name) { return mobility(coco.at(coco.index_of(name))); };
  for (const char* name : {"person", "car", "bus", "truck", "bicycle", "dog", "train"}) {
    EXPECT_EQ(of(name), Mobility::kMobile) << name;
  }
  for (const char* name : {"chair", "hot dog", "teddy bear", "traffic light", "laptop"}) {
    EXPECT_EQ(of(name), Mobility::kCarried) << name;
  }
  for (const char* name : {"road", "sky-other-merged", "building-other-merged"}) {
    EXPECT_EQ(of(name), Mobility::kFixed) << name;
  }
  const LabelSpace vkitti = load_label_space("vkitti2");
  for (const char* name : {"Car", "Van", "Truck"}) {
    EXPECT_EQ(mobility(vkitti.at(vkitti.index_of(name))), Mobility::kMobile) << name;
  }
  const LabelSpace ade = load_label_space("ade20k_150");
  EXPECT_EQ(mobility(ade.at(ade.index_of("person"))), Mobility::kMobile);
  EXPECT_EQ(mobility(ade.at(ade.index_of("table"))), Mobility::kCarried);
}

TEST(Belief, StartsFromClassAndFlag) {
  const LabelSpace coco = load_label_space("coco_panoptic_133");
  BeliefOptions options;
  options.mobile = 0.4;
  options.carried = 3;
  options.flagged = -2;
  options.unflagged = 0.5;
  const InitialBelief start(options, coco);
  const auto car = coco.index_of("car");
  const auto chair = coco.index_of("chair");
  EXPECT_DOUBLE_EQ(start.log_odds(make_prior(car, 1, 1, 50, true)), -1.6);
  EXPECT_DOUBLE_EQ(start.log_odds(make_prior(car, 1, 1, 0, false)), 0.9);
  EXPECT_DOUBLE_EQ(start.log_odds(make_prior(chair, 1, 1, 0, false)), 3.5);
  Prior unjudged = make_prior(car, 1, 1, 0, false);
  unjudged.unjudged = 1;
  EXPECT_DOUBLE_EQ(start.log_odds(unjudged), 0.4);
  EXPECT_EQ(start.mobility(kVoidLabel), Mobility::kFixed);
  EXPECT_EQ(InitialBelief{}.mobility(car), Mobility::kFixed);
  options.mobile = 21;
  EXPECT_THROW(options.check(), Error);
}

TEST(Belief, StandsInThePlaceOfMotion) {
  const Prior prior = make_prior(3, 7, 100, 40, true);
  const Prior still = with_belief(prior, 1.0);
  EXPECT_EQ(still, make_prior(3, 7, 100, 0, false));
  const Prior moving = with_belief(prior, 0.25);
  EXPECT_EQ(moving, make_prior(3, 7, 100, 75, true));
  EXPECT_FLOAT_EQ(p_static(moving), 0.25f);
}

}  // namespace
}  // namespace kys::test
