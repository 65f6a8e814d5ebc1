#pragma once

#include <kys_slam/check_pair.h>
#include <kys_slam/frame_source.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>

namespace kys_slam {

/// What PairWatch finds, for callers that are handed frames: of every frame count_frame(), of those
/// it asks for look_at().
class PairHistory {
 public:
  /// The next frame. \returns whether its pair is to be looked at
  bool count_frame();

  /// \param index  of the frame, for the warning
  void look_at(const GrayImage& left, const GrayImage& right, std::int64_t index);

  /// No more frames: what was seen of few pairs is reported.
  void finish();

  /// What is wrong, once enough was seen of it; "" before.
  [[nodiscard]] const std::string& warning() const { return warning_; }

 private:
  std::int64_t frames_ = 0;
  int bad_pairs_ = 0;               // one after the other, by check_stereo_pair
  std::string problem_;             // of the last pair looked at
  std::deque<double> row_offsets_;  // px, of the last pairs looked at
  std::string warning_;
};

/// Hands on the frames of another source and looks at some of them, to tell when left and right
/// image do not belong together: swapped, not rectified, or not of the same moment. Of a pair that
/// is out of step the rows of matches differ by what the camera turned or moved meanwhile, so their
/// median changes from pair to pair; that of a sound rig is constant. Nothing is seen of it while
/// the camera stands still or moves along its baseline. Looks at frames 1, 5, 10, 15, 20, 40, 60,
/// 80, 100 and then every 100th; about 20 ms each, so best read by a ReadAhead.
class PairWatch : public FrameSource {
 public:
  using Tell = std::function<void(const std::string& warning)>;

  /// \param source  must outlive this object and not be read by anyone else
  /// \param tell    called by next(), once at most
  PairWatch(FrameSource& source, Tell tell) : source_(source), tell_(std::move(tell)) {}

  [[nodiscard]] const StereoCamera& camera() const override { return source_.camera(); }
  [[nodiscard]] std::optional<std::int64_t> size() const override { return source_.size(); }
  std::optional<StereoFrame> next() override;

  /// What was reported, or "". Not while another thread is in next().
  [[nodiscard]] const std::string& warning() const { return history_.warning(); }

 private:
  FrameSource& source_;
  Tell tell_;
  PairHistory history_;
};

}  // namespace kys_slam
