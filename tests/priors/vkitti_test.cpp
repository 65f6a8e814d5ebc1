// SPDX-License-Identifier: BSD-3-Clause
// Virtual KITTI 2's own pictures, in tiny made-up folders: encodings as in its documentation.
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>

#include "priors/input/field_input.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam {
namespace {

namespace fs = std::filesystem;
constexpr RgbPixel kUndefined = {0, 0, 0}, kRoad = {100, 60, 100}, kCar = {255, 127, 80},
                   kVan = {0, 139, 139};

class VkittiTest : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::temp_directory_path() / ("kys_vkitti_test_" + std::to_string(::getpid()));
    fs::remove_all(root_);
    for (const char* kind :
         {"instanceSegmentation", "classSegmentation", "depth", "forwardFlow", "backwardFlow"}) {
      fs::create_directories(root_ / kind / "Camera_0");
    }
  }
  void TearDown() override { fs::remove_all(root_); }

  void write_segments(const std::vector<RgbPixel>& classes,
                      const std::vector<std::uint8_t>& instances) const {
    RgbImage class_image(static_cast<int>(classes.size()), 1);
    GrayImage instance_image(static_cast<int>(instances.size()), 1);
    std::copy(classes.begin(), classes.end(), class_image.data());
    std::copy(instances.begin(), instances.end(), instance_image.data());
    write_png(root_ / "classSegmentation/Camera_0/classgt_00007.png", class_image);
    write_png(root_ / "instanceSegmentation/Camera_0/instancegt_00007.png", instance_image);
  }

  [[nodiscard]] std::string error_of(const kys::LabelSpace& labels, int width) const {
    try {
      static_cast<void>(PanopticReader(instances(), labels).read("rgb_00007", width, 1));
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }

  [[nodiscard]] fs::path instances() const { return root_ / "instanceSegmentation/Camera_0"; }

  fs::path root_;
  kys::LabelSpace labels_ = kys::load_label_space("vkitti2");
};

TEST_F(VkittiTest, ClassesAndInstancesBecomeOnePanopticMap) {
  // Undefined; road; two cars; a van; a car without an instance; a road pixel at a car's edge.
  write_segments({kUndefined, kRoad, kCar, kCar, kVan, kCar, kRoad}, {0, 0, 3, 12, 12, 0, 3});
  const PanopticReader reader(instances(), labels_);
  EXPECT_EQ(reader.encoding(), PanopticEncoding::kVkitti);
  const PanopticMap map = reader.read("rgb_00007", 7, 1);
  ASSERT_EQ(map.segments.size(), 4u);  // in order of label: road, car 3, car 12, van 12
  EXPECT_EQ(map.segments[0].label, labels_.index_of("Road"));
  EXPECT_FALSE(map.segments[0].thing);
  EXPECT_EQ(map.segments[1].label, labels_.index_of("Car"));
  EXPECT_EQ(map.segments[1].input_id, 3u);
  EXPECT_TRUE(map.segments[1].thing);
  EXPECT_EQ(map.segments[2].input_id, 12u);
  EXPECT_EQ(map.segments[3].label, labels_.index_of("Van"));
  const std::vector<std::uint16_t> expected = {0, 1, 2, 3, 4, 0, 1};
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), map.map.data()));
}

TEST_F(VkittiTest, BadSegmentationsAreNamed) {
  write_segments({kRoad, {1, 2, 3}}, {0, 0});
  EXPECT_NE(error_of(labels_, 2).find("classgt_00007.png: colour (1, 2, 3)"), std::string::npos);
  write_segments({kRoad, kRoad}, {0, 0, 0});
  EXPECT_NE(error_of(labels_, 2).find("another size"), std::string::npos);
  write_segments({kRoad, kRoad}, {0, 0});
  EXPECT_NE(error_of(labels_, 3).find("is 2x1, the sequence has 3x1"), std::string::npos);
  EXPECT_NE(error_of(kys::load_label_space("coco_panoptic_133"), 2).find("vkitti2 has it"),
            std::string::npos);
  fs::remove(root_ / "classSegmentation/Camera_0/classgt_00007.png");
  EXPECT_NE(error_of(labels_, 2).find("classgt_00007.png"), std::string::npos);
}

TEST_F(VkittiTest, DepthIsInCentimetresAndTheSkyHasNone) {
  Image16 depth(3, 1);
  depth.data()[0] = 1000;  // 10 m
  depth.data()[1] = 65535;
  depth.data()[2] = 0;
  write_png(root_ / "depth/Camera_0/depth_00007.png", depth);
  const fs::path file = find_disparity(root_ / "depth/Camera_0", "rgb_00007");
  const ImageOf<float> disparity = read_disparity(file, FieldEncoding::kVkitti, 386.0);
  EXPECT_FLOAT_EQ(disparity.at(0, 0), 38.6F);
  EXPECT_TRUE(std::isnan(disparity.at(1, 0)));
  EXPECT_TRUE(std::isnan(disparity.at(2, 0)));
}

TEST_F(VkittiTest, FlowSpansTheImageAndBlueSaysWhetherThereIsAny) {
  Rgb16Image flow(11, 3);
  for (std::size_t i = 0; i < flow.size(); ++i) flow.data()[i] = {0, 0, 0};
  flow.at(0, 0) = {65535, 0, 65535};      // as far right and up as there is: 10 px, -2 px
  flow.at(1, 0) = {49151, 32768, 65535};  // three quarters of the way: 5 px, about 0
  write_png(root_ / "forwardFlow/Camera_0/flow_00007.png", flow);
  const FlowField read =
      read_flow(find_flow(root_ / "forwardFlow/Camera_0", "rgb_00007"), FieldEncoding::kVkitti);
  EXPECT_NEAR(read.u.at(0, 0), 10, 1e-6);
  EXPECT_NEAR(read.v.at(0, 0), -2, 1e-6);
  EXPECT_NEAR(read.u.at(1, 0), 5, 2e-4);
  EXPECT_NEAR(read.v.at(1, 0), 0, 1e-4);
  EXPECT_TRUE(std::isnan(read.u.at(2, 0)));
}

TEST_F(VkittiTest, BackwardFlowIsFiledUnderTheLaterFrame) {
  const fs::path folder = root_ / "backwardFlow/Camera_0";
  write_png(folder / "backwardFlow_00008.png", Rgb16Image(2, 2));
  EXPECT_EQ(find_back_flow(folder, "rgb_00007", "rgb_00008"), folder / "backwardFlow_00008.png");
  EXPECT_THROW(find_back_flow(folder, "rgb_00008", "rgb_00009"), InputError);
  write_png(folder / "000007.png", Rgb16Image(2, 2));  // everybody else's convention
  EXPECT_EQ(find_back_flow(folder, "000007", "000008"), folder / "000007.png");
  // The forward flow in its place is none.
  const fs::path forward = root_ / "forwardFlow/Camera_0";
  write_png(forward / "flow_00007.png", Rgb16Image(2, 2));
  EXPECT_THROW(find_back_flow(forward, "rgb_00007", "rgb_00008"), InputError);
}

std::string message(const std::function<void()>& f) {
  try {
    f();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST_F(VkittiTest, AMissingFileIsCalledByItsName) {
  const std::string depth = message([&] { find_disparity(root_ / "depth", "rgb_00007"); });
  EXPECT_NE(depth.find("depth_00007.png"), std::string::npos) << depth;
  const std::string flow = message([&] { find_flow(root_ / "flow", "rgb_00007"); });
  EXPECT_NE(flow.find("flow_00007.png"), std::string::npos) << flow;
  const std::string back = message([&] { find_back_flow(root_ / "b", "rgb_00007", "rgb_00008"); });
  EXPECT_NE(back.find("backwardFlow_00008.png"), std::string::npos) << back;
  const std::string other = message([&] { find_flow(root_ / "flow", "000007"); });
  EXPECT_EQ(other.find("flow_"), std::string::npos) << other;
}

TEST_F(VkittiTest, ItsPicturesAreNotTakenForKittis) {
  const fs::path depth = root_ / "depth_00007.png", flow = root_ / "flow_00007.png";
  write_png(depth, Image16(3, 1));
  write_png(flow, Rgb16Image(3, 1));
  const FieldEncoding unspecified = FieldEncoding::kUnspecified;
  EXPECT_NE(message([&] { read_disparity(depth, unspecified, 386.0); }).find("give the encoding"),
            std::string::npos);
  EXPECT_NE(message([&] { read_flow(flow, unspecified); }).find("give the encoding"),
            std::string::npos);
  EXPECT_NO_THROW(read_disparity(depth, FieldEncoding::kKitti, 386.0));  // asked for
  write_png(root_ / "000007.png", Image16(3, 1));
  EXPECT_NO_THROW(read_disparity(root_ / "000007.png", unspecified, 386.0));
}

}  // namespace
}  // namespace kys_slam
