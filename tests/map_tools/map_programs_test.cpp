// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/saved_map.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "io/temporary_folder.h"
#include "map_tools/arc_features.h"
#include "support/run_command.h"

// map_info, refine_map, merge_maps and evaluate_map on maps of simulated features.
namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using testing::Command;
using testing::count_lines;
using testing::read_text;

constexpr int kTownFrames = 60;
const StereoCamera kTownCamera{1241, 376, 718.856, 718.856, 607.1928, 185.2157, 0.5371657};

class MapPrograms : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    simulate("town", 1);
    simulate("other", 2);
    run("town", "first", {"--frames", "40"});
    run("town", "second", {"--start", "20"});
    run("other", "elsewhere", {"--frames", "40"});
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::string at(const std::string& name) { return (*folder_ / name).string(); }

  static void simulate(const std::string& name, std::uint32_t seed) {
    simulator::FeatureOptions options;
    options.seed = seed;
    testing::write_arc(at(name + ".features"), kTownCamera, kTownFrames, options);
  }
  static void run(const std::string& world, const std::string& map,
                  std::vector<std::string> options) {
    options.insert(options.begin(), {at(world + ".features"), "--output", at(map), "--quiet",
                                     "--schedule", "sequential", "--save-map", at(map + ".map"),
                                     "--set", "calibration.enabled=false"});
    Command command("run_stereo_kitti", options);
    ASSERT_EQ(command.wait(), 0) << command.err();
  }
  /// One line on stderr that names `part`, status 2, and nothing written.
  static void expect_refused(const std::string& program, const std::vector<std::string>& arguments,
                             const std::string& part) {
    Command command(program, arguments);
    EXPECT_EQ(command.wait(), 2) << program << " " << part;
    EXPECT_EQ(count_lines(command.err()), 1) << command.err();
    EXPECT_NE(command.err().find(part), std::string::npos) << command.err();
    EXPECT_FALSE(fs::exists(at("x.map")));
  }

  static std::unique_ptr<TemporaryFolder> folder_;
};
std::unique_ptr<TemporaryFolder> MapPrograms::folder_;

TEST_F(MapPrograms, InfoSaysWhatTheMapHolds) {
  Command info("map_info", {at("first.map"), "--json", "--keyframes", at("first.tum")});
  ASSERT_EQ(info.wait(), 0) << info.err();
  const auto json = nlohmann::json::parse(info.out());
  const MapSnapshot map = SavedMap(at("first.map")).snapshot();
  EXPECT_EQ(json["version"], 2);
  EXPECT_EQ(json["keyframes"], map.keyframes.size());
  EXPECT_EQ(json["landmarks"], map.landmarks.size());
  EXPECT_EQ(json["camera"]["width"], 1241);
  EXPECT_EQ(json["features"]["levels"], 8);
  ASSERT_EQ(json["submaps"].size(), 1U);
  EXPECT_NEAR(json["submaps"][0]["path_m"], 60 * 0.39, 1.5);
  EXPECT_EQ(static_cast<std::size_t>(count_lines(read_text(at("first.tum")))),
            map.keyframes.size());
  Command text("map_info", {at("first.map")});
  ASSERT_EQ(text.wait(), 0);
  EXPECT_NE(text.out().find("format version 2"), std::string::npos);
}

TEST_F(MapPrograms, ARefinedMapIsContinued) {
  const std::vector<std::string> call{
      at("first.map"),   "-o",           at("refined.map"), "--free",
      "offset,rotation", "--covariance", "--quiet"};
  Command refine("refine_map", call);
  ASSERT_EQ(refine.wait(), 0) << refine.err();
  EXPECT_EQ(refine.err(), "");
  const std::string once = read_text(at("refined.map"));
  const auto json = nlohmann::json::parse(read_text(at("refinement.json")));
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["parameters"].size(), 17U);
  for (const auto& p : json["parameters"]) {
    const bool free = p["name"] == "offset" || p["name"] == "row" || p["name"] == "yaw" ||
                      p["name"] == "pitch" || p["name"] == "roll";
    EXPECT_EQ(p["free"], free) << p;
    if (!free) {
      EXPECT_EQ(p["after"], p["before"]);
    }
  }
  EXPECT_GT(json["residuals_px"]["refined"]["held_out"]["count"], 50);
  ASSERT_TRUE(read_correction_file(at("refined_calibration.yaml")));
  const MapSnapshot before = SavedMap(at("first.map")).snapshot();
  const MapSnapshot after = SavedMap(at("refined.map")).snapshot();
  ASSERT_EQ(after.keyframes.size(), before.keyframes.size());
  EXPECT_LE(after.landmarks.size(), before.landmarks.size()) << "some became one";
  EXPECT_GT(10 * after.landmarks.size(), 9 * before.landmarks.size());
  EXPECT_EQ(json["associations"].size(), 2U);
  EXPECT_GT(json["residuals_px"]["found_anew"]["held_out"]["count"], 50);
  EXPECT_EQ(static_cast<std::size_t>(count_lines(read_text(at("covariances.csv")))),
            4 + after.keyframes.size());
  Command again("refine_map", call);
  ASSERT_EQ(again.wait(), 0);
  EXPECT_EQ(read_text(at("refined.map")), once) << "the same bytes";
  Command run("run_stereo_kitti",
              {at("town.features"), "--start", "30", "--output", at("continued"), "--quiet",
               "--schedule", "sequential", "--load-map", at("refined.map"), "--localize-only"});
  ASSERT_EQ(run.wait(), 0) << run.err();
  EXPECT_GT(count_lines(read_text(at("continued/trajectory.tum"))), 5) << "its frames are found";
}

/// Observations that a wrong pose denies leave the map, and are found again by the right one.
TEST_F(MapPrograms, ObservationsAreFoundAnew) {
  SavedMap map(at("first.map"));
  const auto observed_by = [](const MapObservations& all, std::uint32_t keyframe) {
    return std::count_if(all.observations.begin(), all.observations.end(),
                         [&](const auto& o) { return o.keyframe == keyframe; });
  };
  const MapObservations before = map.observations();
  const auto middle = static_cast<std::uint32_t>(before.T_c_w.size() / 2);
  const std::ptrdiff_t whole = observed_by(before, middle);
  ASSERT_GT(whole, 100);
  MapObservations moved = before;
  moved.T_c_w[middle].translation.x() += 3;  // 54 px at 40 m
  map.update(moved);
  const AssociationReport wrong = map.associate();
  EXPECT_GT(wrong.dropped, 0.9 * static_cast<double>(whole));
  const MapObservations without = map.observations();
  ASSERT_EQ(without.T_c_w.size(), before.T_c_w.size());
  EXPECT_LT(observed_by(without, middle), 0.3 * static_cast<double>(whole));
  MapObservations back = without;
  back.T_c_w = before.T_c_w;
  map.update(back);
  const AssociationReport right = map.associate();
  EXPECT_GT(right.found, 0.5 * static_cast<double>(whole));
  EXPECT_GT(observed_by(map.observations(), middle), 0.7 * static_cast<double>(whole));
}

/// The example of other measurements: a map that a drift has bent comes to where positions are, in
/// their frame.
TEST_F(MapPrograms, PositionsPlaceAMap) {
  const Rigid3 T_gps_world(Eigen::Quaterniond(Eigen::AngleAxisd(2, Eigen::Vector3d(1, 2, 2) / 3)),
                           {400, -300, 50});
  std::map<double, Eigen::Vector3d> truth;
  std::string lines, on_a_line;
  for (int i = 0; i < 40; ++i) {
    const double a = 0.01 * i, time = 100 + 0.1 * i;
    const Eigen::Vector3d p =
        T_gps_world * Eigen::Vector3d(60 * (1 - std::cos(a)), 0, 60 * std::sin(a));
    truth[time] = p;
    lines += fmt::format("{:.6f} {:.9f} {:.9f} {:.9f} 1e-4 0 0 1e-4 0 1e-4\n", time, p.x(), p.y(),
                         p.z());
    on_a_line += fmt::format("{:.6f} {} 0 0 1 0 0 1 0 1\n", time, i);
  }
  write_text(at("positions.txt"), lines);
  SavedMap saved(at("first.map"));
  MapObservations bent = saved.observations(MapSelection::all());
  for (std::size_t k = 0; k < bent.T_c_w.size(); ++k) {  // 1 % longer
    bent.T_c_w[k].translation *= 1.01;
  }
  for (Eigen::Vector3d& p : bent.landmarks) p *= 1.01;
  saved.update(bent);
  saved.write(at("bent.map"));
  Command refine("refine_with_gps", {at("bent.map"), at("positions.txt"), at("placed.map")});
  ASSERT_EQ(refine.wait(), 0) << refine.err();
  const MapSnapshot placed = SavedMap(at("placed.map")).snapshot();
  ASSERT_GT(placed.keyframes.size(), 5U);
  for (const auto& keyframe : placed.keyframes) {
    const auto at_time = truth.lower_bound(keyframe.timestamp - 0.01);
    ASSERT_NE(at_time, truth.end());
    EXPECT_LT((keyframe.T_w_c.translation - at_time->second).norm(), 0.03) << keyframe.id;
  }
  write_text(at("bad.txt"), lines + "104.0 1 2\n");
  write_text(at("few.txt"), "100 0 0 0 1 0 0 1 0 1\n");
  write_text(at("line.txt"), on_a_line);
  write_text(at("negative.txt"), "100 0 0 0 -1 0 0 1 0 1\n");
  for (const auto& [file, message] : {std::pair("bad.txt", "bad line"),
                                      {"few.txt", "too few"},
                                      {"missing.txt", "no numbers"},
                                      {"line.txt", "on a line"},
                                      {"negative.txt", "bad line"}}) {
    expect_refused("refine_with_gps", {at("first.map"), at(file), at("x.map")}, message);
  }
}

TEST_F(MapPrograms, TwoPartsOfATownBecomeOneMap) {
  Command merge("merge_maps", {at("first.map"), at("second.map"), "-o", at("both.map")});
  ASSERT_EQ(merge.wait(), 0) << merge.out() << merge.err();
  const MapSnapshot a = SavedMap(at("first.map")).snapshot();
  const MapSnapshot b = SavedMap(at("second.map")).snapshot();
  const MapSnapshot both = SavedMap(at("both.map")).snapshot();
  EXPECT_EQ(both.keyframes.size(), a.keyframes.size() + b.keyframes.size());
  EXPECT_LT(both.landmarks.size(), a.landmarks.size() + b.landmarks.size()) << "some are the same";
  for (std::size_t k = 1; k < both.keyframes.size(); ++k) {
    EXPECT_LT(both.keyframes[k - 1].id, both.keyframes[k].id);
    EXPECT_EQ(both.keyframes[k].submap, both.keyframes[0].submap) << "one map";
  }
  // Frames that are in both lie at the same place, 20 frames along the circle.
  int common = 0;
  for (std::size_t k = 0; k < a.keyframes.size(); ++k) {
    for (std::size_t j = a.keyframes.size(); j < both.keyframes.size(); ++j) {
      if (both.keyframes[k].timestamp != both.keyframes[j].timestamp) continue;
      ++common;
      EXPECT_LT((both.keyframes[k].T_w_c.translation - both.keyframes[j].T_w_c.translation).norm(),
                0.05);
    }
  }
  EXPECT_GT(common, 3);
  const Eigen::Vector3d end = both.keyframes.back().T_w_c.translation;
  const double angle = 0.01 * (both.keyframes.back().timestamp - 100) * 10;
  EXPECT_LT((end - 60 * Eigen::Vector3d(1 - std::cos(angle), 0, std::sin(angle))).norm(), 0.5);
  Command run("run_stereo_kitti",
              {at("town.features"), "--output", at("in_both"), "--quiet", "--schedule",
               "sequential", "--load-map", at("both.map"), "--localize-only"});
  EXPECT_EQ(run.wait(), 0) << run.err();
}

TEST_F(MapPrograms, TwoTownsStayApart) {
  Command merge("merge_maps", {at("first.map"), at("elsewhere.map"), "-o", at("x.map")});
  EXPECT_EQ(merge.wait(), 3);
  EXPECT_NE(merge.out().find("no common place found"), std::string::npos) << merge.out();
  EXPECT_NE(merge.out().find(" keyframes of "), std::string::npos) << "what was tried";
  EXPECT_FALSE(fs::exists(at("x.map")));
}

TEST_F(MapPrograms, BadInputIsNamed) {
  write_text(at("empty.map"), "");
  write_text(at("text.map"), "no map");
  const std::string map = read_text(at("first.map"));
  write_text(at("short.map"), map.substr(0, map.size() / 2));
  std::string damaged = map;
  damaged[map.size() / 2] = static_cast<char>(damaged[map.size() / 2] ^ 1);
  write_text(at("damaged.map"), damaged);
  write_text(at("cloud.xyz"), "0 0 0\n1 0 0\n0 1 0\n");
  write_text(at("bad.xyz"), "0 0\n");
  for (const char* name : {"empty.map", "text.map", "short.map", "damaged.map", "missing.map"}) {
    expect_refused("map_info", {at(name)}, name);
    expect_refused("refine_map", {at(name), "-o", at("x.map")}, name);
    expect_refused("merge_maps", {at("first.map"), at(name), "-o", at("x.map")}, name);
    expect_refused("merge_maps", {at(name), at("first.map"), "-o", at("x.map")}, name);
    expect_refused("evaluate_map", {at(name), "--truth", at("cloud.xyz")}, name);
  }
  expect_refused("refine_map", {at("first.map"), "-o", at("x.map"), "--free", "lens"}, "lens");
  expect_refused("refine_map", {at("first.map"), "-o", at("first.map")}, "is the input");
  expect_refused("refine_map", {at("first.map"), "-o", at("no/x.map")}, "no/x.map");
  expect_refused("merge_maps", {at("first.map"), at("first.map"), "-o", at("x.map")}, "twice");
  for (const char* name : {"bad.xyz", "missing.ply"}) {
    expect_refused("evaluate_map", {at("first.map"), "--truth", at(name)}, name);
  }
  expect_refused("evaluate_map",
                 {at("cloud.xyz"), "--truth", at("cloud.xyz"), "--trajectory-truth",
                  at("first/trajectory.tum")},
                 "has no keyframes");
}

TEST_F(MapPrograms, AMapAgreesWithItsOwnPoints) {
  Command evaluate("evaluate_map",
                   {at("first.map"), "--truth", at("first/map.ply"), "--json", at("e.json"),
                    "--ply", at("e.ply"), "--trajectory-truth", at("first/keyframes.tum")});
  ASSERT_EQ(evaluate.wait(), 0) << evaluate.err();
  const auto json = nlohmann::json::parse(read_text(at("e.json")));
  EXPECT_EQ(json["accuracy"]["share"]["0.02"], 1) << json;
  EXPECT_EQ(json["completeness"]["share"]["0.02"], 1);
  EXPECT_NEAR(json["scale"], 1, 1e-9);
}

}  // namespace
}  // namespace kys_slam
