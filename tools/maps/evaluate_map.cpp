// SPDX-License-Identifier: BSD-3-Clause
// evaluate_map: a map against points of the true surfaces.
#include <fmt/format.h>
#include <kys/error.h>
#include <kys/label_space.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/saved_map.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "common/command_line.h"
#include "map_evaluation.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Arguments {
  fs::path map, truth, trajectory_truth, trajectory, transform, json, ply;
  bool scale = false;
  bool icp = false;
};

void declare(CLI::App& app, Arguments& a) {
  app.add_option("MAP", a.map, "map of a run (--save-map), or points: map.ply, PLY, PCD, text")
      ->required();
  one_at_a_time(app.add_option("--truth", a.truth, "points of the true surfaces: PLY, PCD, text"))
      ->required();
  auto* poses = one_at_a_time(
      app.add_option("--trajectory-truth", a.trajectory_truth,
                     "true poses of the left camera in the frame of the points (TUM), to which the "
                     "map's keyframes are aligned"));
  one_at_a_time(app.add_option("--trajectory", a.trajectory,
                               "poses of the map when it is points (keyframes.tum of the run)"))
      ->needs(poses);
  app.add_flag("--scale", a.scale, "with trajectories: the map's scale is free")->needs(poses);
  one_at_a_time(app.add_option("--transform", a.transform,
                               "the alignment, map to truth: 12 numbers, rows of [R|t]"))
      ->excludes(poses);
  app.add_flag("--icp", a.icp, "refine the alignment by the points");
  one_at_a_time(app.add_option("--json", a.json, "file for the figures"));
  one_at_a_time(app.add_option("--ply", a.ply, "file for the map's points, coloured by error"));
}

/// The landmarks of the largest sub-map.
EvaluatedMap read_saved_map(const fs::path& file) {
  const SavedMap saved(file);
  const MapSnapshot snapshot = saved.snapshot();
  EvaluatedMap map;
  std::map<std::uint32_t, Eigen::Vector3d> centres;
  for (const MapSnapshot::KeyFrame& k : snapshot.keyframes) {
    centres[k.id] = k.T_w_c.translation;
    if (k.submap == snapshot.main_submap) map.keyframes.push_back({k.timestamp, k.T_w_c});
  }
  std::stable_sort(
      map.keyframes.begin(), map.keyframes.end(),
      [](const TimedPose& a, const TimedPose& b) { return a.timestamp < b.timestamp; });
  bool labelled = false;
  for (const MapSnapshot::Landmark& l : snapshot.landmarks) {
    if (l.submap != snapshot.main_submap) continue;
    map.cloud.points.push_back(l.p_w);
    map.cloud.classes.push_back(l.label == kys::kVoidLabel ? -1 : l.label);
    labelled = labelled || l.label != kys::kVoidLabel;
    map.distance.push_back((l.p_w - centres[l.reference]).norm());
  }
  if (map.cloud.points.empty()) throw InputError(file.string() + ": holds no landmarks");
  if (!labelled) map.cloud.classes.clear();
  const std::string space = saved.info().label_space;
  const auto& known = kys::builtin_label_spaces();
  if (labelled && std::find(known.begin(), known.end(), space) != known.end()) {
    const kys::LabelSpace classes = kys::load_label_space(space);
    for (std::uint16_t k = 0; k < classes.size(); ++k) {
      map.cloud.class_name[k] = classes.at(k).name;
    }
  }
  return map;
}

EvaluatedMap read_any_map(const Arguments& a) {
  if (a.map.extension() == ".map") {
    if (!a.trajectory.empty()) throw InputError("--trajectory: a map has its own keyframes");
    return read_saved_map(a.map);
  }
  EvaluatedMap map;
  map.cloud = read_point_cloud(a.map);
  if (!a.trajectory.empty()) {
    map.keyframes = read_tum_poses(a.trajectory);
  } else if (!a.trajectory_truth.empty()) {
    throw InputError(a.map.string() + ": has no keyframes; give them by --trajectory");
  }
  return map;
}

std::string line(const Distances& d) {
  std::string text = fmt::format("  {:<22} {:>9}", printable(d.name), d.count);
  if (d.count == 0) return text + "\n";
  for (const double share : d.share) text += fmt::format(" {:>7.1f}", 100 * share);
  return text + fmt::format(" {:>9.3f} {:>9.3f}\n", d.median, d.rmse);
}

std::string table(const MapEvaluation& e, const PointCloud& truth) {
  std::string text =
      fmt::format("truth: {} points, {:.3f} m apart (median){}\n", truth.points.size(), e.spacing,
                  e.planes ? ", with normals: distances are those from their planes"
                           : "; distances below that mean nothing");
  text += fmt::format("{:<24} {:>9}", "", "points");
  for (const double near : kNear) text += fmt::format(" {:>5.0f}cm", 100 * near);
  text += fmt::format(" {:>9} {:>9}   (% nearer than; m)\n", "median", "rms");
  text += line(e.map_to_truth);
  for (const auto* list : {&e.by_distance, &e.map_by_class}) {
    for (const Distances& d : *list) text += line(d);
  }
  text += line(e.truth_to_map);
  for (const Distances& d : e.truth_by_class) text += line(d);
  return text;
}

Json to_json(const Distances& d) {
  Json json{{"name", printable(d.name)}, {"count", d.count}};
  if (d.count == 0) return json;
  json["median_m"] = d.median;
  json["mean_m"] = d.mean;
  json["rms_m"] = d.rmse;
  for (std::size_t k = 0; k < kNear.size(); ++k) {
    json["share"][fmt::format("{:.2f}", kNear.at(k))] = d.share.at(k);
  }
  return json;
}

Json to_json(const std::vector<Distances>& list) {
  Json json = Json::array();
  for (const Distances& d : list) json.push_back(to_json(d));
  return json;
}

Json figures(const Arguments& a, const MapEvaluation& e, const PointCloud& truth) {
  const Eigen::Matrix<double, 3, 4> M = e.alignment.T.matrix();
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) rows.push_back(M(r, c));
  }
  return {{"map", printable(a.map.string())},
          {"truth", printable(a.truth.string())},
          {"truth_points", truth.points.size()},
          {"truth_spacing_m", e.spacing},
          {"truth_normals", e.planes},
          {"scale", e.alignment.scale},
          {"T_truth_map", rows},
          {"accuracy", to_json(e.map_to_truth)},
          {"accuracy_by_distance", to_json(e.by_distance)},
          {"accuracy_by_class", to_json(e.map_by_class)},
          {"completeness", to_json(e.truth_to_map)},
          {"completeness_by_class", to_json(e.truth_by_class)}};
}

int run(const Arguments& a) {
  for (const fs::path& output : {a.json, a.ply}) {
    if (output.empty()) continue;
    for (const fs::path& input : {a.map, a.truth}) {
      if (is_same_path(output, input)) throw InputError(output.string() + ": is an input");
    }
    check_writable(output);
  }
  EvaluateOptions options;
  options.scale = a.scale;
  options.icp = a.icp;
  if (!a.trajectory_truth.empty()) options.trajectory_truth = read_tum_poses(a.trajectory_truth);
  if (!a.transform.empty()) {
    const std::vector<Rigid3> poses = read_kitti_poses(a.transform);
    if (poses.size() != 1) throw InputError(a.transform.string() + ": has to hold 12 numbers");
    options.T_truth_map = poses.front();
  }
  const EvaluatedMap map = read_any_map(a);
  const PointCloud truth = read_point_cloud(a.truth);
  const MapEvaluation evaluation = evaluate_map(map, truth, options);
  print_text(table(evaluation, truth));
  if (!a.json.empty()) write_file_atomic(a.json, figures(a, evaluation, truth).dump(2) + "\n");
  if (!a.ply.empty()) write_file_atomic(a.ply, error_ply(map, evaluation));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_map", [&] {
    Arguments arguments;
    CLI::App app(
        "Compares a map with points of the true surfaces: accuracy (map to truth) and completeness "
        "(truth to map), by class and distance. Without an option the map is in the frame of the "
        "truth already.",
        "evaluate_map");
    declare(app, arguments);
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    return run(arguments);
  });
}
