// SPDX-License-Identifier: BSD-3-Clause
#include "perturbation.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/read_bytes.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "exposure.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class PerturbationTest : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("kys_perturbation_test_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    fs::create_directories(root_ / "pan");
    fs::create_directories(root_ / "flow");
  }
  void TearDown() override { fs::remove_all(root_); }

  /// Two frames of 200 cars or persons each, a road and a sky.
  void write_segments() const {
    Json document;
    for (int t = 0; t < 2; ++t) {
      const std::string name = "00000" + std::to_string(t) + ".png";
      Json info = {{{"id", 1000}, {"category_id", 149}}, {{"id", 1001}, {"category_id", 187}}};
      for (int id = 1; id <= 200; ++id) {
        info.push_back({{"id", id}, {"category_id", id % 2 == 0 ? 3 : 1}});
      }
      document["annotations"].push_back({{"file_name", name}, {"segments_info", info}});
      write_png(root_ / "pan" / name, RgbImage(4, 4));
    }
    std::ofstream(root_ / "pan.json") << document.dump();
  }

  /// Category by frame and segment.
  [[nodiscard]] std::map<std::pair<std::string, int>, int> categories(const fs::path& json) const {
    std::ifstream stream(json);
    std::map<std::pair<std::string, int>, int> out;
    const Json document = Json::parse(stream);
    for (const Json& a : document["annotations"]) {
      for (const Json& s : a["segments_info"]) {
        out[{a["file_name"], s["id"]}] = s["category_id"];
      }
    }
    return out;
  }

  /// A flow of (3, 4) px, 5 px long; one pixel without, one that stands still.
  void write_flow() const {
    Rgb16Image flow(64, 48);
    for (std::size_t i = 0; i < flow.size(); ++i) {
      flow.data()[i] = {32768 + 3 * 64, 32768 + 4 * 64, 1};
    }
    flow.at(5, 5)[2] = 0;
    flow.at(6, 5) = {32768, 32768, 1};
    write_png(root_ / "flow" / "000000.png", flow);
  }

  [[nodiscard]] FlowField disturbed(double relative, double correlation) const {
    disturb_flow((root_ / "flow").string(), (root_ / "out").string(), relative, correlation, 7,
                 FieldEncoding::kKitti);
    return read_flow(root_ / "out" / "000000.png", FieldEncoding::kKitti);
  }

  fs::path root_;
  kys::LabelSpace labels_ = kys::load_label_space("coco_panoptic_133");
};

TEST_F(PerturbationTest, RelabelledSegmentsAreNestedAndOnlyThings) {
  write_segments();
  const auto before = categories(root_ / "pan.json");
  std::map<double, std::map<std::pair<std::string, int>, int>> after;
  for (const double share : {0.0, 0.1, 0.3, 0.6}) {
    const std::string output = (root_ / "out").string();
    const Relabelling done = relabel_segments((root_ / "pan").string(), output, share, 3, labels_);
    EXPECT_EQ(done.things, 400u);
    EXPECT_NEAR(static_cast<double>(done.hit) / 400, share, 0.06);
    EXPECT_TRUE(fs::exists(root_ / "out" / "000001.png"));
    after[share] = categories(output + ".json");
  }
  EXPECT_EQ(after[0.0], before);
  for (const auto& [segment, category] : before) {
    const int at10 = after[0.1][segment], at30 = after[0.3][segment], at60 = after[0.6][segment];
    if (at10 != category) {
      EXPECT_EQ(at30, at10);
    }
    if (at30 != category) {
      EXPECT_EQ(at60, at30);
    }
    if (segment.second >= 1000) {
      EXPECT_EQ(at60, category);  // stuff
    }
  }
}

TEST_F(PerturbationTest, RelabellingDamagedInputIsAnError) {
  EXPECT_THROW(
      relabel_segments((root_ / "pan").string(), (root_ / "out").string(), 0.1, 3, labels_),
      InputError);
  std::ofstream(root_ / "pan.json") << R"({"annotations":[{}]})";
  EXPECT_THROW(
      relabel_segments((root_ / "pan").string(), (root_ / "out").string(), 0.1, 3, labels_),
      InputError);
}

TEST_F(PerturbationTest, RelabellingDeeplyNestedInputIsAnError) {
  std::ofstream(root_ / "pan.json") << R"({"annotations":[],"info":)" << std::string(200000, '[')
                                    << std::string(200000, ']') << "}";
  EXPECT_THROW(
      relabel_segments((root_ / "pan").string(), (root_ / "out").string(), 0.1, 3, labels_),
      InputError);
}

TEST_F(PerturbationTest, FlowErrorsScaleWithTheFlowAndAreNested) {
  write_flow();
  const FlowField weak = disturbed(0.06, 0), strong = disturbed(0.12, 0);
  double sum = 0, squares = 0, count = 0;
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      if (y == 5 && (x == 5 || x == 6)) continue;
      const double e = weak.u.at(x, y) - 3.0;
      EXPECT_NEAR(strong.u.at(x, y) - 3.0, 2 * e, 0.03);  // steps of 1/64 px
      EXPECT_NEAR(strong.v.at(x, y) - 4.0, 2 * (weak.v.at(x, y) - 4.0), 0.03);
      sum += e;
      squares += e * e;
      ++count;
    }
  }
  EXPECT_NEAR(sum / count, 0, 0.02);
  EXPECT_NEAR(std::sqrt(squares / count), 0.06 * 5, 0.02);
  EXPECT_TRUE(std::isnan(weak.u.at(5, 5)));
  EXPECT_EQ(weak.u.at(6, 5), 0);  // what stands still has no error
}

TEST_F(PerturbationTest, AFolderWithoutFlowAndTheInputAsOutputAreErrors) {
  EXPECT_THROW((void)disturbed(0.1, 0), InputError);
  write_flow();
  const std::string flow = (root_ / "flow").string();
  EXPECT_THROW(disturb_flow(flow, flow, 0.1, 0, 7, FieldEncoding::kKitti), InputError);
  write_segments();
  const std::string segments = (root_ / "pan").string();
  EXPECT_THROW(relabel_segments(segments, segments, 0.1, 3, labels_), InputError);
}

TEST_F(PerturbationTest, WhatPerceptionWasMadeOfIsKept) {
  write_flow();
  std::ofstream(root_ / "flow" / "images.txt") << "image_2\n";
  (void)disturbed(0.1, 0);
  EXPECT_EQ(read_text(root_ / "out" / "images.txt"), "image_2\n");
  write_segments();
  std::ofstream(root_ / "pan" / "images.txt") << "image_0\n";
  relabel_segments((root_ / "pan").string(), (root_ / "out2").string(), 0.1, 3, labels_);
  EXPECT_EQ(read_text(root_ / "out2" / "images.txt"), "image_0\n");
}

TEST_F(PerturbationTest, CorrelatedFlowErrorsAreAlikeNearby) {
  write_flow();
  const auto neighbours = [](const FlowField& flow) {  // correlation of errors one pixel apart
    double product = 0, square = 0;
    for (int y = 10; y < 48; ++y) {
      for (int x = 0; x + 1 < 64; ++x) {
        product += (flow.u.at(x, y) - 3) * (flow.u.at(x + 1, y) - 3);
        square += (flow.u.at(x, y) - 3) * (flow.u.at(x, y) - 3);
      }
    }
    return product / square;
  };
  EXPECT_NEAR(neighbours(disturbed(0.2, 0)), 0, 0.1);
  EXPECT_GT(neighbours(disturbed(0.2, 16)), 0.9);
}

TEST(Exposure, CountsKeypointsWhosePriorDiffers) {
  std::vector<kys::Prior> a(5), b(5);
  for (std::size_t i = 0; i < 5; ++i) {
    a[i].label = b[i].label = 2;
    a[i].instance = b[i].instance = 7;
  }
  b[1].label = kys::kVoidLabel;     // another class
  b[2].instance = 8;                // another identity: not wrong by itself
  a[3].dynamic = b[3].dynamic = 1;  // mu across 8
  a[3].motion = 8;
  b[3].motion = 8.5F;
  b[4].dynamic = 1;  // flagged, across both gates
  b[4].motion = 30;
  Exposure e;
  e.add(a, b);
  EXPECT_EQ(e.keypoints, 5u);
  EXPECT_EQ(e.label, 1u);
  EXPECT_EQ(e.instance, 2u);
  EXPECT_EQ(e.dynamic, 1u);
  EXPECT_EQ(e.stereo_gate, 2u);
  EXPECT_EQ(e.temporal_gate, 1u);
  EXPECT_EQ(e.any, 3u);
  Exposure twice = e;
  twice += e;
  EXPECT_EQ(twice.any, 6u);
}

}  // namespace
}  // namespace kys_slam
