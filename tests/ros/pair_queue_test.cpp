// SPDX-License-Identifier: BSD-3-Clause
#include "pair_queue.h"

#include <gtest/gtest.h>
#include <kys_slam/error.h>

#include <vector>

namespace kys_slam::ros {
namespace {

using Arrival = PairQueue::Arrival;

ImageMessage at_ms(std::int64_t ms) {
  ImageMessage message;
  message.stamp = {static_cast<std::int32_t>(ms / 1000),
                   static_cast<std::uint32_t>(ms % 1000 * 1000000)};
  return message;
}

std::vector<std::pair<std::int64_t, std::int64_t>> pairs_ms(PairQueue& queue) {
  std::vector<std::pair<std::int64_t, std::int64_t>> all;
  while (const auto pair = queue.take()) {
    all.emplace_back(pair->left.stamp.nanoseconds() / 1000000,
                     pair->right.stamp.nanoseconds() / 1000000);
  }
  return all;
}

using Pairs = std::vector<std::pair<std::int64_t, std::int64_t>>;

TEST(PairQueue, JoinsWithinTheToleranceInAnyOrderOfArrival) {
  PairQueue queue(0.01, 10, 1);
  for (const int ms : {0, 50, 100}) queue.add(Side::kRight, at_ms(ms + 10));
  for (const int ms : {0, 50, 100}) queue.add(Side::kLeft, at_ms(ms));
  queue.add(Side::kLeft, at_ms(150));
  queue.add(Side::kRight, at_ms(161));  // 11 ms apart
  EXPECT_EQ(pairs_ms(queue), (Pairs{{0, 10}, {50, 60}, {100, 110}}));
  EXPECT_EQ(queue.counts().paired, 3);
  EXPECT_EQ(queue.counts().unmatched, 1);
}

TEST(PairQueue, TakesTheNearerOfTwoCandidates) {
  PairQueue queue(0.02, 10, 1);
  queue.add(Side::kLeft, at_ms(0));
  queue.add(Side::kLeft, at_ms(14));
  queue.add(Side::kRight, at_ms(15));
  EXPECT_EQ(pairs_ms(queue), (Pairs{{14, 15}}));
  EXPECT_EQ(queue.counts().unmatched, 1);
}

TEST(PairQueue, BoundsWhatWaitsAndCountsWhatGoes) {
  PairQueue queue(0.01, 4, 1);
  for (int i = 0; i < 7; ++i) queue.add(Side::kLeft, at_ms(100 * i));  // the right camera is dead
  EXPECT_EQ(queue.counts().unmatched, 3);
  for (int i = 7; i < 13; ++i) {
    queue.add(Side::kLeft, at_ms(100 * i));
    queue.add(Side::kRight, at_ms(100 * i));
  }
  EXPECT_EQ(queue.counts().unmatched, 7);
  EXPECT_EQ(queue.counts().dropped, 2);
  EXPECT_EQ(pairs_ms(queue), (Pairs{{900, 900}, {1000, 1000}, {1100, 1100}, {1200, 1200}}));
}

TEST(PairQueue, LateAndRepeatedImagesAreLeftOut) {
  PairQueue queue(0.01, 10, 1);
  EXPECT_EQ(queue.add(Side::kLeft, at_ms(2000)), Arrival::kTaken);
  EXPECT_EQ(queue.add(Side::kLeft, at_ms(2000)), Arrival::kOutOfOrder);
  EXPECT_EQ(queue.add(Side::kLeft, at_ms(1001)), Arrival::kOutOfOrder);
  EXPECT_EQ(queue.counts().out_of_order, 2);
  EXPECT_EQ(queue.add(Side::kRight, at_ms(2000)), Arrival::kTaken);
  EXPECT_EQ(pairs_ms(queue), (Pairs{{2000, 2000}}));
}

/// A bag that is played in a loop: each side goes back once.
TEST(PairQueue, ARecordingThatStartsAgain) {
  PairQueue queue(0.01, 10, 1);
  for (int i = 0; i < 3; ++i) {
    queue.add(Side::kLeft, at_ms(5000 + 50 * i));
    queue.add(Side::kRight, at_ms(5000 + 50 * i));
  }
  queue.add(Side::kLeft, at_ms(5150));
  EXPECT_EQ(queue.add(Side::kLeft, at_ms(0)), Arrival::kTimeJump);
  EXPECT_TRUE(queue.empty());  // what waited is of the time before
  EXPECT_EQ(queue.add(Side::kRight, at_ms(0)), Arrival::kTaken);
  EXPECT_EQ(pairs_ms(queue), (Pairs{{0, 0}}));
}

TEST(ImageMessage, ViewsOfEncodings) {
  const std::vector<std::uint8_t> bytes = {10, 20, 30, 255, 40, 50, 60, 255};
  ImageMessage message;
  message.width = 2, message.height = 1, message.step = 8;
  message.data = bytes;
  const auto grey = [&](const char* encoding, bool big = false) {
    message.encoding = encoding;
    message.is_bigendian = big;
    const GrayImage image = to_gray(view_of(message));
    return std::pair<int, int>(image.at(0, 0), image.at(1, 0));
  };
  using Two = std::pair<int, int>;
  EXPECT_EQ(grey("mono8"), Two(10, 20));
  EXPECT_EQ(grey("mono16"), Two(20, 255));  // upper bytes
  EXPECT_EQ(grey("mono16", true), Two(10, 30));
  EXPECT_EQ(grey("rgb8").first, 18);    // 0.299 10 + 0.587 20 + 0.114 30 = 18.15
  EXPECT_EQ(grey("bgr8").first, 22);    // 0.299 30 + 0.587 20 + 0.114 10 = 21.85
  EXPECT_EQ(grey("rgba8").second, 48);  // 0.299 40 + 0.587 50 + 0.114 60 = 48.15
  EXPECT_EQ(grey("bgra8").second, 52);
}

TEST(ImageMessage, ThatCannotBeIsRefused) {
  const std::vector<std::uint8_t> bytes(8);
  ImageMessage message;
  message.data = bytes;
  message.encoding = "mono8";
  message.width = 4, message.height = 2, message.step = 4;
  EXPECT_NO_THROW(view_of(message));
  const auto refuses = [](const ImageMessage& m, const char* why) {
    try {
      view_of(m);
      ADD_FAILURE() << why;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  ImageMessage bad = message;
  bad.height = 3;
  refuses(bad, "too few");
  bad = message, bad.step = 3;
  refuses(bad, "too few");
  bad = message, bad.width = 0;
  refuses(bad, "too few");
  bad = message, bad.step = 0xffffffff, bad.height = 0xffffffff;
  refuses(bad, "too few");
  bad = message, bad.encoding = "bayer_rggb8";
  refuses(bad, "image_proc");
  bad = message, bad.encoding = "";
  refuses(bad, "''");
}

}  // namespace
}  // namespace kys_slam::ros
