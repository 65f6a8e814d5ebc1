// SPDX-License-Identifier: BSD-3-Clause
#include "node_options.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <fstream>
#include <map>
#include <set>

#include "io/temporary_folder.h"

namespace kys_slam::ros {
namespace {

using Type = Settings::Type;
using Values = std::map<std::string, std::string>;

GivenValue given(Values values) {
  return [values](const Parameter& p) -> std::optional<std::string> {
    const auto found = values.find(p.key);
    if (found == values.end()) return std::nullopt;
    return found->second;
  };
}

std::string complaint(const Values& values) {
  try {
    const NodeOptions options = read_options(given(values));
    read_settings(options, given(values));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

const Parameter& named(const std::vector<Parameter>& all, const std::string& key) {
  const auto found = std::ranges::find(all, key, &Parameter::key);
  if (found == all.end()) throw std::out_of_range(key);
  return *found;
}

TEST(NodeParameters, TypesRangesAndWords) {
  const std::vector<Parameter> own = node_parameters();
  std::set<std::string> keys;
  for (const bool driving : {false, true}) {
    for (const Parameter& p : setting_parameters(driving)) keys.insert(p.key);
  }
  for (const Parameter& p : own) {
    EXPECT_FALSE(description_of(p).empty()) << p.key;
    EXPECT_FALSE(keys.contains(p.key)) << p.key << " is a setting too";
  }
  const Parameter& queue = named(own, "queue");
  EXPECT_EQ(queue.type, Type::kInteger);
  EXPECT_EQ(queue.least, 1);
  EXPECT_EQ(queue.most, 1000);
  EXPECT_EQ(named(own, "tolerance").type, Type::kReal);
  EXPECT_EQ(named(own, "driving").type, Type::kTruth);
  EXPECT_EQ(named(own, "output").type, Type::kText);
  const Parameter& schedule = named(own, "schedule");
  EXPECT_EQ(schedule.type, Type::kChoice);
  EXPECT_EQ(schedule.value, "realtime");
  EXPECT_NE(description_of(schedule).find("one of sequential pipelined realtime"),
            std::string::npos);
}

TEST(NodeParameters, AreTheSettingsOfTheSystem) {
  const std::vector<Parameter> settings = setting_parameters(false);
  const Parameter& features = named(settings, "orb.features");
  EXPECT_EQ(features.type, Type::kInteger);
  EXPECT_EQ(features.value, "1200");
  EXPECT_EQ(named(setting_parameters(true), "orb.features").value, Settings().get("orb.features"));
  EXPECT_LT(features.least, 1200);
  EXPECT_GT(features.most, 1200);
  const Parameter& mode = named(settings, "kys.mode");
  EXPECT_EQ(mode.type, Type::kChoice);
  EXPECT_TRUE(std::ranges::count(mode.choices, "verified"));
  EXPECT_EQ(named(settings, "orb.scale_factor").type, Type::kReal);
  EXPECT_EQ(named(settings, "control.blend_poses").type, Type::kTruth);
  EXPECT_EQ(named(settings, "control.label_space").type, Type::kText);
}

TEST(NodeParameters, BecomeOptionsAndSettings) {
  const Values values = {{"queue", "3"},       {"tolerance", "0.02"},   {"schedule", "sequential"},
                         {"camera.x", "0.25"}, {"orb.features", "900"}, {"segments", "true"},
                         {"driving", "true"},  {"images", "rectified"}};
  const NodeOptions options = read_options(given(values));
  EXPECT_EQ(options.queue, 3);
  EXPECT_EQ(options.tolerance, 0.02);
  EXPECT_EQ(options.schedule, Schedule::kSequential);
  EXPECT_EQ(options.images, Images::kRectified);
  EXPECT_EQ(options.T_base_camera().t(), Eigen::Vector3d(0.25, 0, 0));
  const Settings settings = read_settings(options, given(values));
  EXPECT_EQ(settings.get("orb.features"), "900");
  EXPECT_EQ(settings.get("kys.mode"), "verified");
  EXPECT_EQ(settings.get("control.segment_every"), "1");
}

/// A value that is given counts, also when it is the default.
TEST(NodeParameters, CountMoreThanTheFile) {
  const TemporaryFolder folder;
  const std::string file = (folder / "own.yaml").string();
  std::ofstream(file) << "orb:\n  features: 800\nkys:\n  mode: mask\n";
  const auto features = [&](const Values& values) {
    const NodeOptions options = read_options(given(values));
    return read_settings(options, given(values)).get("orb.features");
  };
  EXPECT_EQ(features({}), "1200");
  EXPECT_EQ(features({{"settings_file", file}}), "800");
  EXPECT_EQ(features({{"settings_file", file}, {"orb.features", "1200"}}), "1200");
  const Values values = {{"settings_file", file}, {"segments", "true"}};
  EXPECT_EQ(read_settings(read_options(given(values)), given(values)).get("kys.mode"), "mask");
}

TEST(NodeParameters, AreRefusedByName) {
  EXPECT_EQ(complaint({}), "");
  EXPECT_EQ(complaint({{"queue", "0"}}), "parameter queue must be between 1 and 1000, is 0");
  EXPECT_NE(complaint({{"schedule", "fast"}}).find("parameter schedule is 'fast'"),
            std::string::npos);
  EXPECT_NE(complaint({{"orb.features", "-1"}}).find("orb.features"), std::string::npos);
  EXPECT_NE(complaint({{"odom_frame", "map"}}).find("different names"), std::string::npos);
  EXPECT_EQ(complaint({{"camera_pose", "tf"}}), "");
  EXPECT_NE(complaint({{"camera_pose", "tf"}, {"camera.pitch", "0.1"}}).find("camera_pose tf"),
            std::string::npos);
  EXPECT_NE(complaint({{"localize_only", "true"}}).find("needs load_map"), std::string::npos);
  EXPECT_NE(complaint({{"settings_file", "/nowhere.yaml"}}).find("/nowhere.yaml"),
            std::string::npos);
}

}  // namespace
}  // namespace kys_slam::ros
