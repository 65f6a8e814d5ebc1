// SPDX-License-Identifier: BSD-3-Clause
#include "priors/input/panoptic_input.h"

#include <gtest/gtest.h>
#include <kys_slam/image_file.h>

#include "io/temporary_folder.h"

namespace kys_slam {
namespace {

class PanopticFolder : public ::testing::Test {
 protected:
  /// Columns of these colours, or of these values.
  void write(const std::vector<RgbPixel>& colours) {
    RgbImage image(static_cast<int>(8 * colours.size()), 6);
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < image.width(); ++x)
        image.at(x, y) = colours[static_cast<std::size_t>(x / 8)];
    }
    write_png(file_, image);
  }
  void write(const std::vector<std::uint8_t>& values) {
    GrayImage image(static_cast<int>(8 * values.size()), 6);
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < image.width(); ++x)
        image.at(x, y) = values[static_cast<std::size_t>(x / 8)];
    }
    write_png(file_, image);
  }
  PanopticReader open(PanopticEncoding encoding = PanopticEncoding::kAuto) {
    return {folder_ / "pan", labels_, encoding};
  }

  PanopticFolder() { std::filesystem::create_directories(folder_ / "pan"); }

  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "pan/0.png";
  const kys::LabelSpace labels_ = kys::load_label_space("coco_panoptic_133");
};

TEST_F(PanopticFolder, NumbersOfSegmentsWithoutTheirJsonAreNoClasses) {
  // COCO's category 1 is person, 3 is car: here they are the first and the third segment.
  write(std::vector<RgbPixel>{{1, 0, 0}, {2, 0, 0}, {3, 0, 0}});
  expect_input_error([&] { open(); }, {"pan.json: missing", "--panoptic-encoding two-channel"});
  const PanopticMap map = open(PanopticEncoding::kTwoChannel).read("0", 24, 6);
  EXPECT_EQ(labels_.at(map.segments.at(0).label).name, "person");
  write(std::vector<RgbPixel>{{1, 0, 0}, {44, 1, 0}, {0, 1, 0}});  // 300 and 256
  expect_input_error([&] { open(); }, {"pan.json: missing", "COCO panoptic"});
  write(std::vector<std::uint8_t>{0, 1, 2, 3, 4, 5, 6});
  expect_input_error([&] { open(); }, {"pan.json: missing", "--panoptic-encoding class-map"});
}

TEST_F(PanopticFolder, CategoriesAreRead) {
  write(std::vector<RgbPixel>{{3, 1, 0}, {3, 2, 0}, {149, 0, 0}});
  EXPECT_EQ(open().encoding(), PanopticEncoding::kTwoChannel);
  EXPECT_EQ(open().read("0", 24, 6).segments.size(), 3u);
  write(std::vector<std::uint8_t>{1, 3, 149, 187, 255});
  EXPECT_EQ(open().encoding(), PanopticEncoding::kClassMap);
  EXPECT_EQ(open().read("0", 40, 6).segments.size(), 4u);
  write(std::vector<std::uint8_t>{1, 2, 3});  // three classes that happen to follow each other
  EXPECT_EQ(open().encoding(), PanopticEncoding::kClassMap);
}

}  // namespace
}  // namespace kys_slam
