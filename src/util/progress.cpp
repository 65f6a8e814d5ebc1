// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/progress.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <utility>

namespace kys_slam {
namespace {

constexpr double kBarInterval = 0.1;   // s between redraws
constexpr double kLineInterval = 5.0;  // s between lines
constexpr double kFirstLine = 2.0;     // s until the first one

double seconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

std::string clock_text(double seconds) {
  const auto whole = static_cast<long>(std::min(std::max(seconds, 0.0), 359999.0));
  char text[32];
  if (whole >= 3600) {
    std::snprintf(text, sizeof text, "%ld:%02ld:%02ld", whole / 3600, whole / 60 % 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%ld:%02ld", whole / 60, whole % 60);
  }
  return text;
}

}  // namespace

Progress::Progress(std::string label, std::optional<std::int64_t> total, Style style,
                   std::FILE* out)
    : label_(std::move(label)),
      total_(total && *total > 0 ? total : std::nullopt),
      style_(style),
      out_(out),
      begin_(Clock::now()),
      shown_(begin_) {
  if (style_ == Style::kAuto) {
    style_ = ::isatty(::fileno(out_)) == 1 ? Style::kBar : Style::kLines;
  }
}

Progress::~Progress() {
  if (style_ == Style::kBar && bar_length_ > 0) {
    draw_bar(seconds(Clock::now() - begin_), "");
    std::fputc('\n', out_);
    std::fflush(out_);
  }
}

void Progress::update(std::int64_t done, const std::string& note) {
  done_ = done;
  if (style_ == Style::kNone) return;
  const Clock::time_point now = Clock::now();
  const double elapsed = seconds(now - begin_);
  const double since_shown = seconds(now - shown_);
  if (style_ == Style::kBar) {
    if (bar_length_ > 0 && since_shown < kBarInterval && done != total_) return;
    draw_bar(elapsed, note);
  } else {
    if (elapsed < kFirstLine || (shown_ != begin_ && since_shown < kLineInterval)) return;
    std::fprintf(out_, "%s%s%s\n", figures(elapsed).c_str(), note.empty() ? "" : "  ",
                 note.c_str());
    std::fflush(out_);
  }
  shown_ = now;
}

std::string Progress::figures(double elapsed) const {
  std::string text = label_ + " " + std::to_string(done_);
  if (total_) text += "/" + std::to_string(*total_);
  if (elapsed > 0 && done_ > 0) {
    const double rate = static_cast<double>(done_) / elapsed;
    char buffer[64];
    std::snprintf(buffer, sizeof buffer, "  %.1f/s", rate);
    text += buffer;
    if (total_ && done_ < *total_) {
      text += "  " + clock_text(static_cast<double>(*total_ - done_) / rate) + " left";
    } else {
      text += "  " + clock_text(elapsed);
    }
  }
  return text;
}

void Progress::draw_bar(double elapsed, const std::string& note) {
  constexpr std::int64_t kWidth = 24;
  std::string line;
  if (total_) {
    const std::int64_t filled = std::clamp<std::int64_t>(done_ * kWidth / *total_, 0, kWidth);
    line += '[' + std::string(static_cast<std::size_t>(filled), '#') +
            std::string(static_cast<std::size_t>(kWidth - filled), '.') + "] ";
  }
  line += figures(elapsed);
  if (!note.empty()) line += "  " + note;
  const std::size_t length = line.size();
  if (length < bar_length_) line.append(bar_length_ - length, ' ');  // wipe what was longer
  bar_length_ = length;
  std::fprintf(out_, "\r%s", line.c_str());
  std::fflush(out_);
}

Waiting::Waiting(std::string label, Progress::Style style, std::FILE* out) {
  if (style == Progress::Style::kNone) return;
  thread_ = std::jthread([label = std::move(label), out](const std::stop_token& stop) {
    std::mutex mutex;
    std::condition_variable_any wake;
    std::unique_lock lock(mutex);
    std::chrono::duration<double> pause(kFirstLine);
    for (double elapsed = kFirstLine;; elapsed += kLineInterval) {
      if (wake.wait_for(lock, stop, pause, [&] { return stop.stop_requested(); })) return;
      std::fprintf(out, "%s  %s\n", label.c_str(), clock_text(elapsed).c_str());
      std::fflush(out);
      pause = std::chrono::duration<double>(kLineInterval);
    }
  });
}

}  // namespace kys_slam
