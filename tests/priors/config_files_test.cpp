// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <filesystem>

#include "priors/builder/options_file.h"

namespace kys_slam {
namespace {

std::string of_file(const std::string& name, BuilderOptions options = {}) {
  load_options(std::filesystem::path(KYS_SOURCE_DIR) / "configs" / name, options);
  return to_text(options);
}

TEST(PriorConfigurations, TheDefaultFileIsTheDefault) {
  BuilderOptions other = paper_options();
  EXPECT_NE(to_text(other), to_text({}));
  EXPECT_EQ(of_file("priors_default.yaml", other), to_text({})) << "it names every setting";
}

TEST(PriorConfigurations, ThePapersFileIsLiteral) {
  EXPECT_EQ(of_file("priors_paper.yaml"), to_text(paper_options()));
  BuilderOptions o;
  load_options(std::filesystem::path(KYS_SOURCE_DIR) / "configs" / "priors_paper.yaml", o);
  EXPECT_EQ(o.ego_motion.model, EgoMotionModel::kAsPrinted);
  EXPECT_EQ(o.association.method, AssociationMethod::kCentroid);
  EXPECT_TRUE(o.association.class_agnostic) << "the paper names no classes";
  EXPECT_FALSE(o.flow_check.enabled) << "nor a check of the flow";
  EXPECT_LT(o.detection.reference_floor, 1e-6) << "nor floors";
  EXPECT_EQ(o.detection.uncovered_factor, 0) << "little coverage: static";
  EXPECT_EQ(o.exported.motion_tolerance_steps, 0);
  EXPECT_EQ(o.association.max_distance, 100);
  EXPECT_EQ(o.association.max_missed_frames, 5);
  EXPECT_EQ(o.ego_motion.border, 20);
  EXPECT_EQ(o.ego_motion.iterations, 5);
  EXPECT_EQ(o.drift.sigma, 60);
}

}  // namespace
}  // namespace kys_slam
