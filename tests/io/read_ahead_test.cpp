// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/read_ahead.h>

#include <atomic>

namespace kys_slam {
namespace {

/// Counts up; fails at one frame.
class Counter : public FrameSource {
 public:
  Counter(int count, int fail_at) : count_(count), fail_at_(fail_at) {}
  [[nodiscard]] const StereoCamera& camera() const override { return camera_; }
  [[nodiscard]] std::optional<std::int64_t> size() const override { return count_; }
  std::optional<StereoFrame> next() override {
    if (position_ == fail_at_) throw InputError("frame " + std::to_string(position_));
    if (position_ == count_) return std::nullopt;
    std::optional<StereoFrame> frame(std::in_place);
    frame->index = position_++;
    return frame;
  }
  [[nodiscard]] int position() const { return position_; }

 private:
  StereoCamera camera_;
  int count_, fail_at_;
  std::atomic<int> position_{0};
};

TEST(ReadAhead, DeliversEveryFrameInOrderThenTheEnd) {
  Counter source(500, -1);
  ReadAhead ahead(source, 3);
  EXPECT_EQ(ahead.size(), 500);
  for (int i = 0; i < 500; ++i) ASSERT_EQ(ahead.next()->index, i);
  EXPECT_FALSE(ahead.next());
  EXPECT_FALSE(ahead.next());
}

TEST(ReadAhead, ExceptionComesAfterTheFramesBeforeIt) {
  Counter source(10, 6);
  ReadAhead ahead(source, 4);
  for (int i = 0; i < 6; ++i) ASSERT_EQ(ahead.next()->index, i);
  EXPECT_THROW(ahead.next(), InputError);
  EXPECT_FALSE(ahead.next());
}

TEST(ReadAhead, HoldsNoMoreThanItsDepthAndCanBeLeftEarly) {
  Counter source(1000, -1);
  {
    ReadAhead ahead(source, 4);
    ASSERT_EQ(ahead.next()->index, 0);
  }
  EXPECT_LE(source.position(), 6);  // one taken, four held, one in the reader's hand
}

}  // namespace
}  // namespace kys_slam
