// SPDX-License-Identifier: BSD-3-Clause
#include "label_image.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <cstring>
#include <vector>

namespace kys_slam::ros {
namespace {

/// Ids 7 (road), 26 (car): not the dense indices.
kys::LabelSpace small_space() {
  return {"small",
          {{7, "road", "road", false, false}, {26, "car", "car", true, false}},
          {0, 30, 30, 0}};
}

template <typename T>
struct LabelMessage {
  LabelMessage(const char* encoding, int width, std::vector<T> values_in)
      : values(std::move(values_in)), bytes(values.size() * sizeof(T)) {
    std::memcpy(bytes.data(), values.data(), bytes.size());
    message.encoding = encoding;
    message.width = static_cast<std::uint32_t>(width);
    message.height = static_cast<std::uint32_t>(values.size()) / message.width;
    message.step = message.width * sizeof(T);
    message.data = bytes;
  }
  std::vector<T> values;
  std::vector<std::uint8_t> bytes;
  ImageMessage message;
};

std::vector<int> numbers(const SegmentImage& image) {
  return {image.map.data(), image.map.data() + image.map.size()};
}

TEST(LabelImage, ClassesAndInstances) {
  const LabelMessage<std::int32_t> labels("32SC1", 4,
                                          {7000, 7000, 26001, 26001,  //
                                           26002, -1, 26001, 99000});
  const auto image = segments_of(labels.message, small_space(), 1000);
  EXPECT_EQ(image->map.width(), 4);
  EXPECT_EQ(image->map.height(), 2);
  EXPECT_EQ(numbers(*image), (std::vector<int>{1, 1, 2, 2, 3, 0, 2, 0}));
  ASSERT_EQ(image->segments.size(), 3u);
  EXPECT_EQ(image->segments[0].label, 0);
  EXPECT_EQ(image->segments[1].label, 1);
  EXPECT_EQ(image->segments[2].label, 1);
  EXPECT_NE(image->segments[1].instance, image->segments[2].instance);
}

TEST(LabelImage, SixteenBitsOfEitherByteOrder) {
  LabelMessage<std::uint16_t> labels("16UC1", 2, {26001, 7000});
  EXPECT_EQ(numbers(*segments_of(labels.message, small_space(), 1000)), (std::vector<int>{1, 2}));
  for (std::size_t i = 0; i < labels.bytes.size(); i += 2) {
    std::swap(labels.bytes[i], labels.bytes[i + 1]);
  }
  labels.message.is_bigendian = true;
  const auto image = segments_of(labels.message, small_space(), 1000);
  EXPECT_EQ(numbers(*image), (std::vector<int>{1, 2}));
  EXPECT_EQ(image->segments[0].label, 1);
}

TEST(LabelImage, RowsMayHaveGaps) {
  LabelMessage<std::int32_t> labels("32SC1", 3, {7000, 26001, 5, 26001, 7000, 5});
  labels.message.width = 2;  // step stays that of three
  EXPECT_EQ(numbers(*segments_of(labels.message, small_space(), 1000)),
            (std::vector<int>{1, 2, 2, 1}));
}

/// Two cars of 160 px, one of 140 px, road between them.
TEST(LabelImage, ConnectedPartsOfThingsAreInstances) {
  constexpr int kWidth = 60, kHeight = 20;
  std::vector<std::uint8_t> values(kWidth * kHeight, 7);
  const auto box = [&](int x0, int x1, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      std::fill_n(values.begin() + y * kWidth + x0, x1 - x0, std::uint8_t{26});
    }
  };
  box(0, 10, 0, 16);
  box(10, 20, 16, 20);  // touches the first one at a corner only, and goes on
  box(20, 32, 10, 20);
  box(50, 60, 0, 14);
  const LabelMessage<std::uint8_t> labels("mono8", kWidth, values);
  const auto image = segments_of(labels.message, small_space(), 1000);
  ASSERT_EQ(image->segments.size(), 3u);
  const auto at = [&](int x, int y) { return image->map.at(x, y); };
  const auto label = [&](int x, int y) { return image->segments.at(at(x, y) - 1u).label; };
  EXPECT_EQ(label(5, 5), 1);
  EXPECT_EQ(label(25, 15), 1);
  EXPECT_NE(at(5, 5), at(25, 15));
  EXPECT_EQ(at(12, 18), at(25, 15));
  EXPECT_EQ(at(55, 5), 0);  // too small
  EXPECT_EQ(label(40, 0), 0);
  EXPECT_EQ(at(40, 0), at(0, 19));  // road is one segment
  EXPECT_NE(image->segments[at(5, 5) - 1u].instance, image->segments[at(25, 15) - 1u].instance);
}

TEST(LabelImage, WhatItCannotBe) {
  const auto refuses = [](const ImageMessage& m, const std::string& why) {
    try {
      segments_of(m, small_space(), 1000);
      ADD_FAILURE() << why;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  const LabelMessage<std::uint8_t> colour("rgb8", 3, {7, 26, 0});
  refuses(colour.message, "'rgb8'");
  const LabelMessage<std::uint8_t> unknown("mono8", 2, {3, 4});
  refuses(unknown.message, "label space small");
  const LabelMessage<std::int32_t> other("32SC1", 2, {3000, 4000});
  refuses(other.message, "label space small");
  LabelMessage<std::int32_t> cut("32SC1", 2, {7000, 7000});
  cut.message.data = cut.message.data.first(7);
  refuses(cut.message, "too few");
  std::vector<std::int32_t> many(65536);
  for (int i = 0; i < 65536; ++i) many[static_cast<std::size_t>(i)] = 26 * 100000 + i;
  const LabelMessage<std::int32_t> crowd("32SC1", 256, many);
  EXPECT_THROW(segments_of(crowd.message, small_space(), 100000), InputError);
  const LabelMessage<std::int32_t> nothing("32SC1", 2, {0, -1});  // void alone is no error
  EXPECT_TRUE(segments_of(nothing.message, small_space(), 1000)->segments.empty());
}

}  // namespace
}  // namespace kys_slam::ros
