// SPDX-License-Identifier: BSD-3-Clause
#include "diagnostics.h"

#include <array>
#include <cstdio>
#include <string>

namespace kys_slam::ros {

namespace {

/// 2: lost, 1 and above 0: integrity.
int badness(const FrameReport& report) {
  if (report.status == FrameStatus::kLost) return 3;
  return static_cast<int>(report.integrity);
}

std::string with_reason(const char* what, const std::string& reason) {
  return reason.empty() ? what : std::string(what) + ": " + reason;
}

}  // namespace

void DiagnosticsLog::add(const FrameReport& report) {
  stamps_.push_back(report.timestamp);
  if (stamps_.size() > kRateFrames) stamps_.pop_front();
  ++frames_;
  if (report.status == FrameStatus::kLost) ++lost_;
  if (report.segments_of >= 0) ++segmented_;
  if (new_frames_ == 0 || badness(report) >= badness(worst_)) worst_ = report;
  ++new_frames_;
  last_ = report;
  error.clear();
}

void DiagnosticsLog::restart() {
  stamps_.clear();
  new_frames_ = 0;
  info_changed = false;
  error.clear();
}

/// Frames per s, by the stamps of the last ones.
double DiagnosticsLog::rate() const {
  if (stamps_.size() < 2) return 0;
  const double seconds = stamps_.back() - stamps_.front();
  return seconds > 0 ? static_cast<double>(stamps_.size() - 1) / seconds : 0;
}

/// The first that applies: what keeps the node from tracking, then the frames, then losses.
std::pair<Diagnostics::Level, std::string> DiagnosticsLog::state(const PairCounts& counts) const {
  if (!error.empty()) return {Diagnostics::Level::kError, error};
  if (!missing_info.empty())
    return {Diagnostics::Level::kWarn, "no camera_info of " + missing_info};
  if (new_frames_ == 0) {
    if (counts.paired > before_.paired)
      return {Diagnostics::Level::kWarn, "pairs wait to be tracked"};
    if (counts.out_of_order > before_.out_of_order) {
      return {Diagnostics::Level::kError, "stamps of images do not increase"};
    }
    const bool alone = counts.unmatched > before_.unmatched;
    return {Diagnostics::Level::kStale, alone ? "images without a partner" : "no images"};
  }
  if (worst_.status == FrameStatus::kLost) {
    return {Diagnostics::Level::kError, with_reason("lost", worst_.reason)};
  }
  const char* reason = to_string(worst_.integrity_reason);
  if (worst_.integrity == Integrity::kContradicted) {
    return {Diagnostics::Level::kError, with_reason("contradicted", reason)};
  }
  if (info_changed)
    return {Diagnostics::Level::kWarn, "camera_info has changed, which is refused until a reset"};
  if (worst_.integrity == Integrity::kDegraded) {
    return {Diagnostics::Level::kWarn, with_reason("degraded", reason)};
  }
  if (counts.dropped > before_.dropped) {
    return {Diagnostics::Level::kWarn, "pairs are dropped: tracking is slower than the camera"};
  }
  if (!worst_.warning.empty()) return {Diagnostics::Level::kWarn, worst_.warning};
  return {Diagnostics::Level::kOk, "ok"};
}

Diagnostics DiagnosticsLog::take(const PairCounts& counts) {
  Diagnostics result;
  std::tie(result.level, result.message) = state(counts);
  std::array<char, 32> rate_text{};
  std::snprintf(rate_text.data(), rate_text.size(), "%.1f", rate());
  const bool has_frame = frames_ > 0;
  const bool has_pose = has_frame && last_.status != FrameStatus::kLost;
  const auto number = [](auto value) { return std::to_string(value); };
  result.values = {
      {"status", has_frame ? to_string(last_.status) : ""},
      {"integrity", has_pose ? to_string(last_.integrity) : ""},
      {"integrity reason", has_pose ? to_string(last_.integrity_reason) : ""},
      {"inliers", number(has_frame ? last_.inliers : 0)},
      {"sub-map", number(has_frame ? last_.submap : -1)},
      {"frame rate (1/s, by stamps)", rate_text.data()},
      {"frames", number(frames_)},
      {"lost frames", number(lost_)},
      {"dropped pairs", number(counts.dropped)},
      {"images without a partner", number(counts.unmatched)},
      {"images out of order", number(counts.out_of_order)},
      {"label images used", number(segmented_)},
      {"label images of no frame", number(stray_segments)},
  };
  new_frames_ = 0;
  before_ = counts;
  return result;
}

}  // namespace kys_slam::ros
