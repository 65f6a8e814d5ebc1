// SPDX-License-Identifier: BSD-3-Clause
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

/// The check of PairWatch, for callers that receive frames. Call count_frame() for every frame, and
/// check() for the frames for which it returns true.
class PairHistory {
 public:
  /// Counts the next frame. \return whether its pair must be given to check()
  bool count_frame();

  /// \param left, right rectified images of equal size \param index of the frame, for the warning
  void check(const GrayImage& left, const GrayImage& right, std::int64_t index);

  /// No more frames: decides from the pairs checked so far.
  void finish();

  /// What is wrong, once enough pairs show it; "" before.
  [[nodiscard]] const std::string& warning() const { return warning_; }

 private:
  std::int64_t frames_ = 0;
  int bad_pairs_ = 0;               // one after the other, by check_stereo_pair
  std::string problem_;             // of the last pair checked
  std::deque<double> row_offsets_;  // px, of the last pairs checked
  std::string warning_;
};

/// Passes on the frames of another source and checks some of them, to report pairs that do not
/// belong together: swapped, not rectified, or not synchronised. The row offset of matches is
/// constant for a good rig. Without synchronisation it changes from pair to pair with the motion of
/// the camera. This cannot be observed while the camera does not move, or moves along its baseline.
/// Checks frames 1, 5, 10, 15, 20, 40, 60, 80, 100 and then every 100th. A check takes about 20 ms,
/// so read this source through a ReadAhead.
class PairWatch : public FrameSource {
 public:
  using Report = std::function<void(const std::string& warning)>;

  /// \param source must outlive this object; only this object may read it \param report called by
  /// next(), once at most
  PairWatch(FrameSource& source, Report report) : source_(source), report_(std::move(report)) {}

  [[nodiscard]] const StereoCamera& camera() const override { return source_.camera(); }
  [[nodiscard]] std::optional<std::int64_t> size() const override { return source_.size(); }
  std::optional<StereoFrame> next() override;

  /// What was reported, or "". Do not call it while another thread is in next().
  [[nodiscard]] const std::string& warning() const { return history_.warning(); }

 private:
  FrameSource& source_;
  Report report_;
  PairHistory history_;
};

}  // namespace kys_slam
