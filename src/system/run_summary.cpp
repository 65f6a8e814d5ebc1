// SPDX-License-Identifier: BSD-3-Clause
#include "system/run_summary.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/process_figures.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "map/map.h"
#include "system/private_access.h"
#include "system/rig_report.h"
#include "system/run_tables.h"

namespace kys_slam {

namespace {

struct Spread {
  double median = 0;
  double p95 = 0;
  double mean = 0;
};

/// Of the back end's stages only frames that became keyframes count.
Spread spread(const FrameReports& reports, const Stage& stage) {
  const bool back_end = stage.value == &StageTimes::local_mapping ||
                        stage.value == &StageTimes::local_bundle ||
                        stage.value == &StageTimes::loop;
  std::vector<double> values;
  for (const FrameReport& report : reports) {
    if (!back_end || report.keyframe) values.push_back(report.times.*stage.value);
  }
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  Spread s;
  s.median = values[values.size() / 2];
  s.p95 = values[std::min(values.size() - 1, values.size() * 95 / 100)];
  for (const double v : values) s.mean += v / static_cast<double>(values.size());
  return s;
}

/// What was wrong with frames, each once with how often and when first.
std::vector<std::string> frame_warnings(const FrameReports& reports) {
  std::map<std::string, std::pair<std::int64_t, std::int64_t>> found;  // frames, the first's index
  for (const FrameReport& r : reports) {
    if (!r.warning.empty()) ++found.try_emplace(r.warning, 0, r.index).first->second.first;
  }
  std::vector<std::string> lines;
  lines.reserve(found.size());
  for (const auto& [warning, frames] : found) {
    lines.push_back(fmt::format("{} ({} of {} frames, the first is {})", warning, frames.first,
                                reports.size(), frames.second));
  }
  return lines;
}

/// Of segments that came late: how many took effect, and how many frames after their own. Nothing
/// without any.
std::optional<nlohmann::ordered_json> segments_json(const FrameReports& reports) {
  std::int64_t count = 0, sum = 0, most = 0;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    if (reports[i].segments_of < 0) continue;
    const std::int64_t late = static_cast<std::int64_t>(i) - reports[i].segments_of;
    ++count;
    sum += late;
    most = std::max(most, late);
  }
  if (count == 0) return std::nullopt;
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  json["frames"] = count;
  json["late_mean"] = static_cast<double>(sum) / static_cast<double>(count);
  json["late_max"] = most;
  return json;
}

/// Frames with a pose that are not sound, by reason.
std::map<std::string, std::int64_t> unsound_frames(const FrameReports& reports) {
  std::map<std::string, std::int64_t> found;
  for (const FrameReport& r : reports) {
    if (r.integrity == Integrity::kOk) continue;
    ++found[fmt::format("{}: {}", to_string(r.integrity), to_string(r.integrity_reason))];
  }
  return found;
}

}  // namespace

std::string summary_json(const System& system, Schedule schedule, const RunInfo& info,
                         const RunOutcome& outcome) {
  // An object from the start: one that becomes an object by operator[] is not sound when memory
  // runs out just then, and crashes when it goes.
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  json["sequence"] = printable(info.sequence);
  json["mode"] = info.mode;
  json["features"] = map_of(system).scales().extractor;
  if (!info.recording.empty()) json["recording"] = info.recording;
  json["schedule"] = to_string(schedule);
  json["complete"] = info.complete;
  if (!info.complete) json["end_reason"] = printable(info.end_reason);
  json["frames"] = outcome.trajectory.size();
  json["frames_tracked"] = outcome.tracked;
  json["keyframes"] = map_of(system).keyframes().size();
  json["keyframes_made"] = outcome.keyframes_made;
  json["landmarks"] = map_of(system).landmarks().size();
  json["loops_closed"] = outcome.loops;
  json["submaps"] = system.submaps();
  json["submaps_merged"] = outcome.merges;
  json["relocalisations"] = outcome.relocalised;
  json["frames_connected"] = outcome.connected.size();
  json["path_length_m"] = path_length(outcome.connected);
  json["missing_priors"] = info.missing_priors;
  json["rig"] = rig_json(system.rig());
  json["integrity"] = nlohmann::ordered_json::object();
  for (const auto& [what, count] : unsound_frames(reports_of(system))) {
    json["integrity"][what] = count;
  }
  json["left_out"] = nlohmann::ordered_json::object();
  for (const auto& [what, count] : info.left_out) json["left_out"][printable(what)] = count;
  json["warnings"] = nlohmann::ordered_json::array();
  for (const std::string& warning : info.warnings) json["warnings"].push_back(printable(warning));
  for (const std::string& warning : frame_warnings(reports_of(system))) {
    json["warnings"].push_back(warning);
  }
  if (const auto& a = outcome.accuracy) {
    json["ate_se3_rmse_m"] = a->ate.rmse;
    json["ate_se3_max_m"] = a->ate.max;
    json["rpe_translation_rmse_m"] = a->rpe_translation.rmse;
    json["rpe_rotation_rmse_deg"] = a->rpe_rotation.rmse;
  }
  kys::Statistics statistics;
  const FrameReports& reports = reports_of(system);
  for (const FrameReport& report : reports) statistics += report.statistics;
  json["descriptor_pairs"] = statistics.total();
  if (const auto segments = segments_json(reports)) json["segments"] = *segments;
  json["timing_ms"] = nlohmann::ordered_json::object();
  for (const Stage& stage : kStages) {
    const Spread s = spread(reports, stage);
    json["timing_ms"][stage.name] = {{"median", s.median}, {"p95", s.p95}, {"mean", s.mean}};
  }
  const double frames = std::max<double>(1, static_cast<double>(outcome.trajectory.size()));
  json["process"] = {{"start_up_s", info.start_up_s},
                     {"wall_s", info.wall_s},
                     {"cpu_ms_per_frame", 1000 * info.cpu_s / frames}};
  json["peak_memory_mb"] = process_figures().peak_resident_mb;
  json["versions"] = {{"kys_slam", KYS_SLAM_VERSION}, {"compiler", __VERSION__}};
  return json.dump(2) + "\n";
}

RunOutcome summarise_run(const System& system, const RunInfo& info) {
  RunOutcome outcome;
  outcome.trajectory = system.trajectory();
  for (const FrameEstimate& estimate : outcome.trajectory) {
    if (estimate.connected) outcome.connected.push_back({estimate.timestamp, estimate.T_w_c});
  }
  if (!info.ground_truth.empty()) {
    try {
      outcome.accuracy = evaluate(info.ground_truth, outcome.connected);
      if (outcome.accuracy->pairs < 3) outcome.accuracy.reset();
    } catch (const InputError&) {  // ground truth that nothing can be compared with
      outcome.accuracy.reset();
    }
  }
  for (const FrameReport& report : reports_of(system)) {
    outcome.tracked += report.status != FrameStatus::kLost ? 1 : 0;
    outcome.keyframes_made += report.keyframe ? 1 : 0;
    outcome.loops += report.loop == LoopEvent::kClosed ? 1 : 0;
    outcome.merges += report.loop == LoopEvent::kMerged ? 1 : 0;
    outcome.relocalised += report.relocalised ? 1 : 0;
  }
  return outcome;
}

std::string describe_failure_to_track(const System& system, const RunOutcome& outcome) {
  const std::size_t frames = outcome.trajectory.size();
  if (frames > 0 && 2 * outcome.connected.size() >= frames) return "";
  const auto tracked = static_cast<std::size_t>(outcome.tracked);
  if (tracked == outcome.connected.size()) {
    return fmt::format("tracking failed: {} of {} frames tracked", tracked, frames);
  }
  return fmt::format(
      "tracking failed: {} of {} frames connected; {} are tracked, in {} sub-maps without a "
      "connection",
      outcome.connected.size(), frames, tracked, system.submaps());
}

std::string describe_run(const System& system, const RunInfo& info, const RunOutcome& outcome) {
  std::string text;
  const auto row = [&](const char* name, const std::string& value) {
    text += fmt::format("  {:<28} {}\n", name, value);
  };
  row("frames tracked", fmt::format("{} of {}", outcome.tracked, outcome.trajectory.size()));
  if (system.submaps() > 1) {
    row("frames connected", fmt::format("{} of {}: trajectory.tum", outcome.connected.size(),
                                        outcome.trajectory.size()));
    row("sub-maps",
        fmt::format("{}: the others are not connected to it, submap_*.tum", system.submaps()));
  }
  row("keyframes, landmarks",
      fmt::format("{}, {}", map_of(system).keyframes().size(), map_of(system).landmarks().size()));
  if (outcome.loops + outcome.merges + outcome.relocalised > 0) {
    row("loops closed", std::to_string(outcome.loops));
    if (system.submaps() == 1) row("sub-maps", "1");
    row("sub-maps merged", std::to_string(outcome.merges));
    row("frames relocalised", std::to_string(outcome.relocalised));
  }
  row("path length", fmt::format("{:.2f} m", path_length(outcome.connected)));
  if (const auto& a = outcome.accuracy) {
    row("ATE (SE(3)), rmse", fmt::format("{:.4f} m", a->ate.rmse));
    row("RPE per frame, rmse",
        fmt::format("{:.4f} m, {:.4f} deg", a->rpe_translation.rmse, a->rpe_rotation.rmse));
  }
  if (const std::string rig = describe_rig(system.rig()); !rig.empty()) row("calibration", rig);
  for (const auto& [what, count] : info.left_out) row(what.c_str(), std::to_string(count));
  const FrameReports& reports = reports_of(system);
  for (const Stage& stage : kStages) {
    const Spread s = spread(reports, stage);
    if (s.mean <= 0) continue;
    row(fmt::format("{} [ms]", stage.name).c_str(),
        fmt::format("median {:6.2f}   p95 {:6.2f}   mean {:6.2f}", s.median, s.p95, s.mean));
  }
  for (const auto& [what, count] : unsound_frames(reports)) {
    row("frames to be doubted", fmt::format("{} {}", count, what));
  }
  const double frames = std::max<double>(1, static_cast<double>(outcome.trajectory.size()));
  row("processor time per frame", fmt::format("{:.1f} ms", 1000 * info.cpu_s / frames));
  row("start-up", fmt::format("{:.3f} s", info.start_up_s));
  row("peak memory", fmt::format("{:.0f} MB", process_figures().peak_resident_mb));
  return text;
}

}  // namespace kys_slam
