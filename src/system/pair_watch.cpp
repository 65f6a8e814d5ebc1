// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/pair_watch.h>

#include <cmath>
#include <numeric>
#include <utility>

namespace kys_slam {

namespace {

constexpr int kBadPairs = 2;           // in a row: one may be fooled by a repeated pattern
constexpr std::size_t kFewest = 4;     // pairs that the scatter of row offsets is reported for
constexpr std::size_t kWindow = 8;     // pairs
constexpr double kMostScatter = 0.25;  // px; sound pairs below 0.05, late ones 0.4 and more

bool is_due(std::int64_t frame) {
  if (frame == 1) return true;
  if (frame == 0) return false;
  return frame % (frame <= 20 ? 5 : frame <= 100 ? 20 : 100) == 0;
}

double scatter(const std::deque<double>& values) {
  const auto count = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / count;
  double sum = 0;
  for (const double v : values) sum += (v - mean) * (v - mean);
  return std::sqrt(sum / (count - 1));
}

}  // namespace

bool PairHistory::count_frame() {
  return is_due(frames_++) && warning_.empty();
}

void PairHistory::finish() {
  if (warning_.empty() && bad_pairs_ >= kBadPairs) warning_ = problem_;
}

void PairHistory::check(const GrayImage& left, const GrayImage& right, std::int64_t index) {
  const PairCheck check = check_stereo_pair(left, right);
  if (check.matches < PairCheck::kMinMatches) return;
  bad_pairs_ = check.problem.empty() ? 0 : bad_pairs_ + 1;
  problem_ = fmt::format("frame {}: {}", index, check.problem);
  row_offsets_.push_back(check.row_offset);
  if (row_offsets_.size() > kWindow) row_offsets_.pop_front();
  // A late image looks like a pair that is not rectified, until several are compared.
  if (row_offsets_.size() < kFewest) return;
  const double px = scatter(row_offsets_);
  if (px > kMostScatter) {
    warning_ = fmt::format(
        "frame {}: left and right images are not of the same moment, or the cameras move against "
        "each other: the row offset of matches changes from pair to pair by {:.2f} px (standard "
        "deviation)",
        index, px);
  } else if (bad_pairs_ >= kBadPairs) {
    warning_ = problem_;
  }
}

std::optional<StereoFrame> PairWatch::next() {
  std::optional<StereoFrame> frame = source_.next();
  if (!history_.warning().empty()) return frame;
  if (!frame) {
    history_.finish();
  } else if (history_.count_frame() && !frame->left.empty()) {
    history_.check(frame->left, frame->right, frame->index);
  }
  if (!history_.warning().empty() && report_) report_(history_.warning());
  return frame;
}

}  // namespace kys_slam
