// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/system.h>

#include <array>
#include <string>
#include <utility>

namespace kys_slam {

const char* to_string(FrameStatus status) {
  switch (status) {
    case FrameStatus::kStarted:
      return "started";
    case FrameStatus::kTracked:
      return "tracked";
    case FrameStatus::kLost:
      break;
  }
  return "lost";
}

const char* to_string(LoopEvent event) {
  switch (event) {
    case LoopEvent::kClosed:
      return "closed";
    case LoopEvent::kMerged:
      return "merged";
    case LoopEvent::kNone:
      break;
  }
  return "";
}

namespace {
constexpr std::array<std::pair<const char*, Schedule>, 3> kSchedules{
    {{"sequential", Schedule::kSequential},
     {"pipelined", Schedule::kPipelined},
     {"realtime", Schedule::kRealtime}}};
}  // namespace

Schedule parse_schedule(std::string_view name) {
  for (const auto& [known, schedule] : kSchedules) {
    if (name == known) return schedule;
  }
  throw InputError("unknown schedule '" + std::string(name) +
                   "': sequential, pipelined or realtime");
}

const char* to_string(Schedule schedule) {
  for (const auto& [name, known] : kSchedules) {
    if (schedule == known) return name;
  }
  return "";
}

}  // namespace kys_slam
