// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/run_main.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/process_figures.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <exception>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>

#include "map/map.h"
#include "system/private_access.h"
#include "system/rig_report.h"

namespace kys_slam {

namespace {

struct Stage {
  const char* name;
  double StageTimes::*value;
};
constexpr std::array<Stage, 10> kStages{{{"total", &StageTimes::total},
                                         {"extract", &StageTimes::extract},
                                         {"priors", &StageTimes::priors},
                                         {"stereo", &StageTimes::stereo},
                                         {"track", &StageTimes::track},
                                         {"predict", &StageTimes::predict},
                                         {"local_map", &StageTimes::local_map},
                                         {"local_mapping", &StageTimes::local_mapping},
                                         {"local_bundle", &StageTimes::local_bundle},
                                         {"loop", &StageTimes::loop}}};

struct Spread {
  double median = 0;
  double p95 = 0;
  double mean = 0;
};

/// Of the back end's stages only frames that became keyframes count.
Spread spread(const std::vector<FrameReport>& reports, const Stage& stage) {
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

/// One row per frame; a frame without a pose repeats the one before (frames.csv tells which).
std::vector<Rigid3> all_poses(const std::vector<FrameEstimate>& trajectory) {
  std::vector<Rigid3> poses;
  for (const FrameEstimate& estimate : trajectory) {
    if (estimate.connected) {
      poses.push_back(estimate.T_w_c);
    } else {
      poses.push_back(poses.empty() ? Rigid3() : poses.back());
    }
  }
  return poses;
}

std::string frames_csv(const System& system, const std::vector<FrameEstimate>& estimates) {
  constexpr std::array<const char*, kys::kTierCount> kTiers{
      "same_instance", "cross_instance", "cross_class", "bypassed", "gated", "filtered", "skipped"};
  std::string text =
      "index,name,timestamp,status,submap,reason,keyframe,loop,loop_frame,loop_distance_m,"
      "loop_gap_m,keypoints,stereo_matches,matches,inliers,prior_coverage,masked,"
      "integrity,integrity_reason";
  for (const char* tier : kTiers) text += fmt::format(",pairs_{0},accepted_{0}", tier);
  for (const Stage& stage : kStages) text += fmt::format(",ms_{}", stage.name);
  text += ",resident_mb\n";
  const std::vector<FrameReport> reports = system.reports();
  for (std::size_t k = 0; k < estimates.size(); ++k) {
    const FrameReport& r = reports[k];
    text +=
        fmt::format("{},{},{:.9f},{},{},\"{}\",{},{},{},{:.4f},{:.4f}", r.index, csv_field(r.name),
                    r.timestamp, to_string(r.status), estimates[k].submap,
                    r.warning.empty() ? r.reason : r.reason + "; " + r.warning, r.keyframe ? 1 : 0,
                    to_string(r.loop), r.loop_frame, r.loop_distance_m, r.loop_gap_m);
    text += fmt::format(",{},{},{},{},{:.4f},{}", r.keypoints, r.stereo_matches, r.matches,
                        r.inliers, r.prior_coverage, r.masked);
    const bool has_pose = r.status != FrameStatus::kLost;
    text += fmt::format(",{},\"{}\"", has_pose ? to_string(r.integrity) : "",
                        to_string(r.integrity_reason));
    for (std::size_t t = 0; t < kys::kTierCount; ++t) {
      text += fmt::format(",{},{}", r.statistics.pairs[t], r.statistics.accepted[t]);
    }
    for (const Stage& stage : kStages) text += fmt::format(",{:.3f}", r.times.*stage.value);
    text += fmt::format(",{:.1f}\n", r.resident_mb);
  }
  return text;
}

/// A row per tracked frame and kind of relative pose. The upper triangle, row by row.
std::string covariance_csv(const System& system) {
  constexpr std::array<const char*, 6> kNames{"rx", "ry", "rz", "tx", "ty", "tz"};
  std::string text = "index,timestamp,kind,other,x,y,z,qx,qy,qz,qw";
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t j = i; j < 6; ++j) text += fmt::format(",{}_{}", kNames[i], kNames[j]);
  }
  text += "\n";
  const auto add = [&](const FrameReport& r, const char* kind, const RelativePose& pose) {
    const Eigen::Vector3d& t = pose.T_other_c.translation;
    const Eigen::Quaterniond& q = pose.T_other_c.rotation;
    text +=
        fmt::format("{},{:.9f},{},{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}", r.index,
                    r.timestamp, kind, pose.other, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    for (int i = 0; i < 6; ++i) {
      for (int j = i; j < 6; ++j) text += fmt::format(",{:.6e}", pose.covariance(i, j));
    }
    text += "\n";
  };
  for (const FrameReport& r : system.reports()) {
    if (r.local) add(r, "local", *r.local);
    if (r.motion) add(r, "motion", *r.motion);
  }
  return text;
}

/// Keyframes that see the same landmarks, the spanning tree, and loops; keyframes by time stamp,
/// the later one first.
std::string graph_csv(const MapSnapshot& map) {
  std::map<std::uint32_t, double> timestamps;
  for (const MapSnapshot::KeyFrame& k : map.keyframes) timestamps[k.id] = k.timestamp;
  std::string text = "timestamp,other,shared_landmarks,spanning_tree,loop\n";
  for (const MapSnapshot::Edge& e : map.edges) {
    text += fmt::format("{:.9f},{:.9f},{},{:d},{:d}\n", timestamps[e.keyframe], timestamps[e.other],
                        e.shared_landmarks, e.spanning_tree, e.loop);
  }
  return text;
}

/// Moving objects, a row per frame and object.
std::string objects_csv(const System& system, const std::string& label_space) {
  std::string text =
      "frame,name,timestamp,instance,class,p_moving,keypoints,x,y,z,vx,vy,vz,sigma_v\n";
  const std::vector<ObjectEstimate> objects = system.objects();
  if (objects.empty()) return text;
  const kys::LabelSpace labels = kys::load_label_space(label_space);
  const std::vector<FrameReport> reports = system.reports();
  for (const ObjectEstimate& o : objects) {
    const FrameReport& report = reports.at(static_cast<std::size_t>(o.frame));
    text += fmt::format("{},{},{:.9f},{},{},{:.4f},{}", report.index, csv_field(report.name),
                        report.timestamp, o.instance, csv_field(labels.at(o.label).name),
                        o.p_moving, o.keypoints);
    text += fmt::format(",{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}\n", o.position.x(),
                        o.position.y(), o.position.z(), o.velocity.x(), o.velocity.y(),
                        o.velocity.z(), std::sqrt(o.velocity_covariance.trace()));
  }
  return text;
}

/// The bytes of a number, little endian.
template <typename T>
void append_bytes(std::string& out, T value) {
  static_assert(std::endian::native == std::endian::little);
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/// A colour that a class keeps in every run; grey without one. Neighbours in the label space
/// differ.
std::array<std::uint8_t, 3> class_colour(std::uint16_t label) {
  if (label == kys::kVoidLabel) return {150, 150, 150};
  std::uint32_t h = label + 1U;
  h = (h ^ (h >> 16U)) * 0x45d9f3bU;
  h = (h ^ (h >> 16U)) * 0x45d9f3bU;
  h ^= h >> 16U;
  const auto channel = [&](unsigned shift) {
    return static_cast<std::uint8_t>(64U + ((h >> shift) & 0x7fU) + ((h >> (shift + 7U)) & 0x3fU));
  };
  return {channel(0), channel(8), channel(16)};
}

/// The landmarks of the trajectory's sub-map as binary PLY.
std::string map_ply(const MapSnapshot& map, const std::string& label_space) {
  std::vector<const MapSnapshot::Landmark*> landmarks;
  std::set<std::uint16_t> labels;
  for (const MapSnapshot::Landmark& l : map.landmarks) {
    if (l.submap != map.main_submap) continue;
    landmarks.push_back(&l);
    if (l.label != kys::kVoidLabel) labels.insert(l.label);
  }
  std::string text =
      "ply\nformat binary_little_endian 1.0\n"
      "comment landmarks, m, frame of the trajectory; class and instance -1: none\n";
  if (!labels.empty()) {
    const kys::LabelSpace space = kys::load_label_space(label_space);
    text += fmt::format("comment label_space {}\n", printable(space.name()));
    for (const std::uint16_t label : labels) {
      text += fmt::format("comment class {} {}\n", label, printable(space.at(label).name));
    }
  }
  text += fmt::format("element vertex {}\n", landmarks.size());
  text +=
      "property float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property int class\nproperty int instance\n"
      "property float belief\nproperty int observations\nend_header\n";
  for (const MapSnapshot::Landmark* l : landmarks) {
    for (int i = 0; i < 3; ++i) append_bytes(text, static_cast<float>(l->p_w[i]));
    for (const std::uint8_t c : class_colour(l->label)) append_bytes(text, c);
    append_bytes<std::int32_t>(text, l->label == kys::kVoidLabel ? -1 : l->label);
    append_bytes(text, l->instance);
    append_bytes(text, l->belief);
    append_bytes(text, static_cast<std::int32_t>(l->observations));
  }
  return text;
}

/// What was wrong with frames, each once with how often and when first.
std::vector<std::string> frame_warnings(const std::vector<FrameReport>& reports) {
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
std::optional<nlohmann::ordered_json> segments_json(const std::vector<FrameReport>& reports) {
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
std::map<std::string, std::int64_t> unsound_frames(const std::vector<FrameReport>& reports) {
  std::map<std::string, std::int64_t> found;
  for (const FrameReport& r : reports) {
    if (r.integrity == Integrity::kOk) continue;
    ++found[fmt::format("{}: {}", to_string(r.integrity), to_string(r.integrity_reason))];
  }
  return found;
}

nlohmann::ordered_json summary(const System& system, Schedule schedule, const RunInfo& info,
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
  for (const auto& [what, count] : unsound_frames(system.reports())) {
    json["integrity"][what] = count;
  }
  json["left_out"] = nlohmann::ordered_json::object();
  for (const auto& [what, count] : info.left_out) json["left_out"][printable(what)] = count;
  json["warnings"] = nlohmann::ordered_json::array();
  for (const std::string& warning : info.warnings) json["warnings"].push_back(printable(warning));
  for (const std::string& warning : frame_warnings(system.reports())) {
    json["warnings"].push_back(warning);
  }
  if (const auto& a = outcome.accuracy) {
    json["ate_se3_rmse_m"] = a->ate.rmse;
    json["ate_se3_max_m"] = a->ate.max;
    json["rpe_translation_rmse_m"] = a->rpe_translation.rmse;
    json["rpe_rotation_rmse_deg"] = a->rpe_rotation.rmse;
  }
  kys::Statistics statistics;
  const std::vector<FrameReport> reports = system.reports();
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
  return json;
}

}  // namespace

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
  for (const FrameReport& report : system.reports()) {
    outcome.tracked += report.status != FrameStatus::kLost ? 1 : 0;
    outcome.keyframes_made += report.keyframe ? 1 : 0;
    outcome.loops += report.loop == LoopEvent::kClosed ? 1 : 0;
    outcome.merges += report.loop == LoopEvent::kMerged ? 1 : 0;
    outcome.relocalised += report.relocalised ? 1 : 0;
  }
  return outcome;
}

namespace {

/// Writes files one by one: one that cannot be written does not keep the others from it.
class Files {
 public:
  template <typename Write>
  void write(Write&& write) {
    try {
      write();
    } catch (...) {
      ++failed_;
      if (!first_) first_ = std::current_exception();
    }
  }

  /// \throws what the first file that failed threw
  void check() const {
    if (!first_) return;
    if (failed_ == 1) std::rethrow_exception(first_);
    const Failure failure = describe_failure(first_);
    const std::string text = fmt::format("{} (and {} more files)", failure.message, failed_ - 1);
    if (failure.status != kBadInput) throw std::runtime_error(text);
    throw InputError(text);
  }

 private:
  int failed_ = 0;
  std::exception_ptr first_;
};

/// submap_N.tum: the frames of every sub-map that is not connected to the one of trajectory.tum,
/// each in a frame of its own. N is that of frames.csv. Files of a run before are removed.
void write_other_submaps(const std::filesystem::path& folder,
                         const std::vector<FrameEstimate>& trajectory, Files& files) {
  for (const std::filesystem::path& file : list_folder(folder)) {
    const std::string name = file.filename().string();
    std::error_code ignored;
    if (name.starts_with("submap_") && name.ends_with(".tum")) {
      std::filesystem::remove(file, ignored);
    }
  }
  std::map<std::int64_t, std::vector<TimedPose>> others;
  for (const FrameEstimate& e : trajectory) {
    if (e.submap >= 0 && !e.connected) others[e.submap].push_back({e.timestamp, e.T_w_c});
  }
  for (const auto& [submap, poses] : others) {
    files.write([&, n = submap, &p = poses] {
      write_tum_poses(folder / fmt::format("submap_{}.tum", n), p);
    });
  }
}

}  // namespace

void write_run(const std::filesystem::path& folder, const System& system, const Settings& settings,
               Schedule schedule, const RunInfo& info, const RunOutcome& outcome) {
  make_output_folder(folder);
  // The summary comes last: without it a folder is not a complete run.
  std::error_code ignored;
  std::filesystem::remove(behind_links(folder / "summary.json"), ignored);
  if (info.ground_truth.empty()) {
    std::filesystem::remove(behind_links(folder / "ground_truth.tum"), ignored);
  }
  Files files;
  files.write([&] { write_tum_poses(folder / "trajectory.tum", outcome.connected); });
  files.write(
      [&] { write_kitti_poses(folder / "trajectory.kitti", all_poses(outcome.trajectory)); });
  files.write([&] { write_tum_poses(folder / "keyframes.tum", system.keyframes()); });
  write_other_submaps(folder, outcome.trajectory, files);
  if (!info.ground_truth.empty()) {
    files.write([&] { write_tum_poses(folder / "ground_truth.tum", info.ground_truth); });
  }
  files.write(
      [&] { write_file_atomic(folder / "frames.csv", frames_csv(system, outcome.trajectory)); });
  files.write([&] { write_file_atomic(folder / "covariance.csv", covariance_csv(system)); });
  files.write([&] {
    write_file_atomic(folder / "objects.csv",
                      objects_csv(system, settings.get("control.label_space")));
  });
  MapSnapshot map;
  files.write([&] { map = system.snapshot(); });
  files.write([&] { write_file_atomic(folder / "graph.csv", graph_csv(map)); });
  files.write([&] {
    write_file_atomic(folder / "map.ply", map_ply(map, settings.get("control.label_space")));
  });
  files.write([&] { write_file_atomic(folder / "config.yaml", settings.to_yaml()); });
  files.write([&] {
    write_file_atomic(folder / "summary.json",
                      summary(system, schedule, info, outcome).dump(2) + "\n");
  });
  files.check();
}

void save_map_or_beside(const System& system, const std::filesystem::path& file,
                        const std::filesystem::path& folder) {
  try {
    system.save_map(file);
  } catch (const InputError& error) {
    const std::filesystem::path instead = folder / "saved.map";
    try {
      system.save_map(instead);
    } catch (const InputError&) {
      throw error;
    }
    throw InputError(std::string(error.what()) + "; the map is in " + instead.string());
  }
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
  const std::vector<FrameReport> reports = system.reports();
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
