// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/rig_file.h>

#include <nlohmann/json.hpp>

#include "io/temporary_folder.h"
#include "map_tools/arc_features.h"
#include "support/run_command.h"

// calibrate_rig on maps of simulated features, and runs that begin with its output.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::count_lines;
using testing::read_text;

constexpr int kFrames = 40;
const StereoCamera kGiven{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};

void simulate_run(const fs::path& folder, const std::string& name, const StereoCamera& camera,
                  std::uint32_t seed) {
  simulator::FeatureOptions options;
  options.seed = seed;
  options.rig_error = simulator::make_rig_error("kitti", camera);
  const fs::path file = folder / (name + ".features");
  testing::write_arc(file, camera, kFrames, options);
  Command run("run_stereo_kitti",
              {file.string(), "--output", (folder / name).string(), "--quiet", "--schedule",
               "sequential", "--save-map", (folder / (name + ".map")).string()});
  ASSERT_EQ(run.wait(), 0) << run.err();
}

class CalibrateRig : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    simulate_run(folder_->path(), "a", kGiven, 1);
    simulate_run(folder_->path(), "b", kGiven, 2);
    StereoCamera other = kGiven;
    other.cx += 1;
    simulate_run(folder_->path(), "other", other, 1);
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string at(const std::string& name) { return (*folder_ / name).string(); }

  /// One line on stderr that names `part`, and status 2.
  static void expect_refused(const std::string& program, const std::vector<std::string>& arguments,
                             const std::string& part) {
    Command command(program, arguments);
    EXPECT_EQ(command.wait(), 2) << part;
    EXPECT_EQ(count_lines(command.err()), 1) << command.err();
    EXPECT_NE(command.err().find(part), std::string::npos) << command.err();
  }

  static std::unique_ptr<TemporaryFolder> folder_;
};
std::unique_ptr<TemporaryFolder> CalibrateRig::folder_;

TEST_F(CalibrateRig, WritesACorrectionThatARunBeginsWith) {
  const std::vector<std::string> call{at("a.map"), at("b.map"),  "-o",     at("r.yaml"),
                                      "--json",    at("r.json"), "--quiet"};
  Command first("calibrate_rig", call);
  ASSERT_EQ(first.wait(), 0) << first.err();
  EXPECT_EQ(first.err(), "");
  const std::string written = read_text(at("r.yaml"));
  const auto file = read_correction_file(at("r.yaml"));
  ASSERT_TRUE(file);
  EXPECT_EQ(file->given, kGiven);
  const auto json = nlohmann::json::parse(read_text(at("r.json")));
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["parameters"].size(), 13 + 2 * 4);
  ASSERT_EQ(json["maps"].size(), 2);
  for (const auto& map : json["maps"]) {
    EXPECT_GT(map["held_out"], 100);
    EXPECT_LT(map["after"]["disparity"], map["before"]["disparity"]);
    EXPECT_LT(map["after"]["row"], map["before"]["row"]);
  }
  Command again("calibrate_rig", call);
  ASSERT_EQ(again.wait(), 0);
  EXPECT_EQ(read_text(at("r.yaml")), written) << "the same bytes";

  const std::vector<std::string> run{at("a.features"), "--output",   at("run"),    "--quiet",
                                     "--schedule",     "sequential", "--save-map", at("run.map")};
  auto with = run;
  with.insert(with.end(), {"--calibration", at("r.yaml")});
  Command begun("run_stereo_kitti", with);
  ASSERT_EQ(begun.wait(), 0) << begun.err();
  EXPECT_NE(read_text(at("run.map")), read_text(at("a.map"))) << "the correction is in use";
  with.insert(with.end(), {"--load-map", at("a.map")});
  expect_refused("run_stereo_kitti", with, "--load-map");
  expect_refused("run_stereo_kitti",
                 {at("other.features"), "--output", at("run2"), "--calibration", at("r.yaml")},
                 "another calibration");

  // The shape of one recording for another.
  Command kept("calibrate_rig", {at("b.map"), "-o", at("k.yaml"), "--keep-shape", at("r.yaml")});
  ASSERT_EQ(kept.wait(), 0) << kept.err();
  const auto of_b = read_correction_file(at("k.yaml"));
  EXPECT_EQ(of_b->estimate.correction[RigParameter::kYaw],
            file->estimate.correction[RigParameter::kYaw]);
}

TEST_F(CalibrateRig, RefusesWhatIsNoMapOfThisRig) {
  const auto refused = [&](const std::vector<std::string>& maps, const std::string& part) {
    auto call = maps;
    call.insert(call.end(), {"-o", at("x.yaml")});
    expect_refused("calibrate_rig", call, part);
    EXPECT_FALSE(fs::exists(at("x.yaml"))) << part;
  };
  write_text(at("empty.map"), "");
  write_text(at("text.map"), "no map");
  const std::string map = read_text(at("a.map"));
  write_text(at("short.map"), map.substr(0, map.size() / 2));
  std::string damaged = map;
  damaged[map.size() / 2] = static_cast<char>(damaged[map.size() / 2] ^ 1);
  write_text(at("damaged.map"), damaged);
  for (const char* name : {"empty.map", "text.map", "short.map", "damaged.map", "missing.map"}) {
    refused({at(name)}, name);
    refused({at("a.map"), at(name)}, name);
  }
  refused({at("a.map"), at("other.map")}, "another camera");
  refused({at("a.map"), at("a.map")}, "twice");
  refused({at("a.map"), "--keep-shape", at("text.map")}, "text.map");
  refused({at("a.map"), "--from", at("text.map")}, "text.map");
  refused({at("a.map"), "--hold-out", "0.9"}, "0.9");
  refused({at("a.map"), "--hold-out", "nan"}, "nan");
  expect_refused("calibrate_rig", {at("a.map"), "-o", at("a.map")}, "a.map");
  EXPECT_EQ(read_text(at("a.map")), map);
  expect_refused("calibrate_rig", {at("a.map"), "-o", at("none/x.yaml")}, "none");
  expect_refused("calibrate_rig", {at("a.map")}, "-o");
}

}  // namespace
}  // namespace kys_slam
