// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/image.h>

namespace kys_slam {
namespace {

TEST(Image, CopiesMovesAndCompares) {
  const GrayImage a(5, 3, 7);
  EXPECT_EQ(a.size(), 15u);
  GrayImage b = a;
  EXPECT_TRUE(a == b);
  b.at(4, 2) = 8;
  EXPECT_FALSE(a == b);
  EXPECT_EQ(a.at(4, 2), 7);
  GrayImage c = std::move(b);
  EXPECT_EQ(c.at(4, 2), 8);
  EXPECT_TRUE(b.empty());  // NOLINT(bugprone-use-after-move): moved-from images are empty
  EXPECT_EQ(b.width(), 0);
  const std::uint8_t* memory = c.data();
  c = a;  // of the same size: into the memory there is
  EXPECT_EQ(c.data(), memory);
  EXPECT_TRUE(a == c);
  c = GrayImage(2, 4);
  EXPECT_EQ(c.width(), 2);
  EXPECT_EQ(c.height(), 4);
  EXPECT_EQ(c.at(1, 3), 0);
  c = a;
  EXPECT_TRUE(a == c);
  EXPECT_FALSE(GrayImage(3, 5, 7) == a);
}

TEST(Image, ForOverwriteHasTheSizeAndHoldsWhatIsWritten) {
  auto image = ImageOf<float>::for_overwrite(3, 2);
  for (std::size_t i = 0; i < image.size(); ++i) image.data()[i] = static_cast<float>(i);
  EXPECT_EQ(image.at(2, 1), 5.0F);
  EXPECT_EQ(image.row(1), image.data() + 3);
  EXPECT_TRUE(ImageOf<float>::for_overwrite(0, 0).empty());
}

}  // namespace
}  // namespace kys_slam
