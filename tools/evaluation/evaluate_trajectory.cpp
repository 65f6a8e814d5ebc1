// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/evaluation.h>
#include <kys_slam/sequence.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "common/command_line.h"

namespace kys_slam {
namespace {

enum class Format { kAuto, kKitti, kTum, kEuroc };

struct Arguments {
  std::string reference, estimate;
  Format reference_format = Format::kAuto, estimate_format = Format::kAuto;
  EvaluationOptions options;
  std::string sensor_yaml, euroc_sequence;
  bool json = false;
};

bool has_commas(const TextRow& row) {
  const char* end = row.fields[0].data() + row.fields[0].size();
  return std::find(end, row.fields[1].data(), ',') != row.fields[1].data();
}

/// Twelve columns: KITTI. Eight: TUM. More, or eight with commas and integer nanoseconds first:
/// EuRoC.
Format format_of(const std::string& path) {
  const TextTable table(path);
  if (table.rows().empty()) throw InputError(path + ": no poses");
  const TextRow& row = table.rows().front();
  const std::size_t columns = row.fields.size();
  if (columns == 12) return Format::kKitti;
  const bool nanoseconds =
      row.fields[0].size() >= 16 && row.fields[0].find('.') == std::string_view::npos;
  if (columns == 8) return nanoseconds && has_commas(row) ? Format::kEuroc : Format::kTum;
  if (columns > 8 && nanoseconds) return Format::kEuroc;
  table.fail(row, std::to_string(columns) +
                      " columns: neither KITTI (12) nor TUM (8) nor an EuRoC ground truth");
}

struct Trajectory {
  bool has_stamps = true;
  std::vector<TimedPose> poses;
};

Trajectory read_trajectory(const std::string& path, Format format) {
  if (format == Format::kAuto) format = format_of(path);
  Trajectory trajectory;
  if (format == Format::kKitti) {
    trajectory.has_stamps = false;
    for (const Rigid3& pose : read_kitti_poses(path)) {
      trajectory.poses.push_back({static_cast<double>(trajectory.poses.size()), pose});
    }
  } else {
    trajectory.poses =
        format == Format::kTum ? read_tum_poses(path, Stamps::kMayRepeat) : read_euroc_poses(path);
  }
  if (trajectory.poses.empty()) throw InputError(path + ": no poses");
  return trajectory;
}

std::string span_of(const std::vector<TimedPose>& poses) {
  char text[100];
  std::snprintf(text, sizeof text, "%.3f to %.3f s", poses.front().timestamp,
                poses.back().timestamp);
  return text;
}

Evaluation evaluate(const Arguments& arguments) {
  Trajectory reference = read_trajectory(arguments.reference, arguments.reference_format);
  Trajectory estimate = read_trajectory(arguments.estimate, arguments.estimate_format);
  if (reference.has_stamps != estimate.has_stamps) {
    throw InputError((reference.has_stamps ? arguments.estimate : arguments.reference) +
                     ": has no time stamps, but the other trajectory has; give both as KITTI or "
                     "both as TUM or EuRoC files");
  }
  std::optional<Rigid3> T_b_c;
  if (!arguments.sensor_yaml.empty()) T_b_c = read_sensor_yaml(arguments.sensor_yaml).T_b_s;
  if (!arguments.euroc_sequence.empty()) T_b_c = read_euroc_T_b_c(arguments.euroc_sequence);
  if (T_b_c) {
    for (TimedPose& pose : reference.poses) pose.T_w_c = pose.T_w_c * *T_b_c;
  }
  if (reference.has_stamps) {
    const Evaluation found = evaluate(reference.poses, estimate.poses, arguments.options);
    if (found.pairs >= 2) return found;
    throw InputError(arguments.estimate + ": only " + std::to_string(found.pairs) +
                     " poses have a reference at their time: " + span_of(estimate.poses) + ", " +
                     arguments.reference + " has " + span_of(reference.poses));
  }
  if (reference.poses.size() != estimate.poses.size()) {
    throw InputError(arguments.estimate + ": " + std::to_string(estimate.poses.size()) +
                     " poses, but " + arguments.reference + " has " +
                     std::to_string(reference.poses.size()));
  }
  return evaluate_pairs({std::move(reference.poses), std::move(estimate.poses)}, arguments.options);
}

nlohmann::ordered_json to_json(const Statistics& s) {
  if (s.count == 0) {
    return {{"count", 0},     {"rmse", nullptr}, {"mean", nullptr}, {"median", nullptr},
            {"std", nullptr}, {"min", nullptr},  {"max", nullptr}};
  }
  return {{"count", s.count}, {"rmse", s.rmse}, {"mean", s.mean}, {"median", s.median},
          {"std", s.std},     {"min", s.min},   {"max", s.max}};
}

void print_json(const Evaluation& e, const Arguments& a) {
  static const char* const kNames[] = {"none", "se3", "sim3"};
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  json["alignment"] = kNames[static_cast<int>(a.options.alignment)];
  json["alignment_degenerate"] = e.alignment.degenerate;
  json["scale"] = e.alignment.scale;
  json["reference_poses"] = e.reference_poses;
  json["estimate_poses"] = e.estimate_poses;
  json["pairs"] = e.pairs;
  json["reference_length_m"] = e.reference_length;
  json["estimate_length_m"] = e.estimate_length;
  json["ate_m"] = to_json(e.ate);
  json["rpe_delta_frames"] = a.options.rpe_delta;
  json["rpe_translation_m"] = to_json(e.rpe_translation);
  json["rpe_rotation_deg"] = to_json(e.rpe_rotation);
  if (e.kitti.segments > 0) {
    json["kitti"] = {{"segments", e.kitti.segments},
                     {"t_rel_percent", e.kitti.translation_percent},
                     {"r_rel_deg_per_100m", e.kitti.rotation_deg_per_100m}};
  }
  std::printf("%s\n", json.dump(2).c_str());
}

void print_row(const char* name, const Statistics& s) {
  if (s.count == 0) {
    std::printf("%-26s %12s %12s %12s %12s %12s %12s\n", name, "-", "-", "-", "-", "-", "-");
    return;
  }
  std::printf("%-26s %12.6f %12.6f %12.6f %12.6f %12.6f %12.6f\n", name, s.rmse, s.mean, s.median,
              s.std, s.min, s.max);
}

void print_table(const Evaluation& e, const Arguments& a) {
  std::printf("poses: %zu reference, %zu estimate, %zu associated\n", e.reference_poses,
              e.estimate_poses, e.pairs);
  std::printf("path length: %.3f m reference, %.3f m estimate\n", e.reference_length,
              e.estimate_length);
  if (a.options.alignment == Alignment::kSim3) std::printf("scale: %.9f\n", e.alignment.scale);
  if (e.alignment.degenerate) {
    std::printf(
        "note: positions do not determine the rotation of the alignment; the first "
        "orientation was used\n");
  }
  std::printf("%-26s %12s %12s %12s %12s %12s %12s\n", "", "rmse", "mean", "median", "std", "min",
              "max");
  print_row("ATE [m]", e.ate);
  const std::string per = " per " + std::to_string(a.options.rpe_delta) + " frame" +
                          (a.options.rpe_delta == 1 ? "" : "s");
  print_row(("E_t [m]" + per).c_str(), e.rpe_translation);
  print_row(("E_R [deg]" + per).c_str(), e.rpe_rotation);
  if (e.kitti.segments > 0) {
    std::printf("KITTI segments (%zu): t_rel %.4f %%, r_rel %.4f deg/100 m\n", e.kitti.segments,
                e.kitti.translation_percent, e.kitti.rotation_deg_per_100m);
  }
}

void add_options(CLI::App& app, Arguments& a) {
  static const std::map<std::string, Alignment> kAlignments = {
      {"none", Alignment::kNone}, {"se3", Alignment::kSe3}, {"sim3", Alignment::kSim3}};
  static const std::map<std::string, Format> kFormats = {{"auto", Format::kAuto},
                                                         {"kitti", Format::kKitti},
                                                         {"tum", Format::kTum},
                                                         {"euroc", Format::kEuroc}};
  app.add_option("--reference", a.reference, "Ground truth: KITTI, TUM or EuRoC file")->required();
  app.add_option("--estimate", a.estimate, "Estimated trajectory: KITTI or TUM file")->required();
  app.add_option("--align", a.options.alignment, "se3 (default), sim3 or none")
      ->transform(CLI::CheckedTransformer(kAlignments).description(""))
      ->option_text("A");
  app.add_option("--rpe", a.options.rpe_delta,
                 "Frames between the two poses of a relative error (1)")
      ->check(CLI::Range(1, 1000000).description(""))
      ->option_text("N");
  app.add_flag("--rpe-all-steps", a.options.rpe_all_steps,
               "With --rpe N: steps from every frame, not from every N-th");
  app.add_option("--max-time-difference", a.options.max_time_difference,
                 "Largest difference of associated time stamps, s (0.01)")
      ->check(finite_range(0, 1e6).description(""))
      ->option_text("S");
  for (auto [flag, format] : {std::pair{"--reference-format", &a.reference_format},
                              std::pair{"--estimate-format", &a.estimate_format}}) {
    app.add_option(flag, *format, "kitti, tum or euroc (default: by content)")
        ->transform(CLI::CheckedTransformer(kFormats).description(""))
        ->option_text("F");
  }
  auto* yaml =
      app.add_option("--body-to-camera", a.sensor_yaml,
                     "The reference is of the body: convert it to the camera of this sensor.yaml");
  app.add_option(
         "--euroc-sequence", a.euroc_sequence,
         "The reference is of the body: convert it to the rectified left camera of this sequence")
      ->excludes(yaml);
  app.add_flag("--json", a.json, "Print JSON");
}

int run(int argc, char** argv) {
  CLI::App app(
      "Compares an estimated trajectory with ground truth: absolute error after alignment, "
      "relative "
      "errors per frame, KITTI's segment errors. Poses with time stamps (TUM, EuRoC) are "
      "associated by time; KITTI files row by row. The figures are those of evo.");
  Arguments arguments;
  add_options(app, arguments);
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  const Evaluation evaluation = evaluate(arguments);
  if (evaluation.pairs < 2) {
    throw InputError(arguments.estimate + ": only " + std::to_string(evaluation.pairs) +
                     " poses have a reference at their time");
  }
  arguments.json ? print_json(evaluation, arguments) : print_table(evaluation, arguments);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_trajectory", [&] { return kys_slam::run(argc, argv); });
}
