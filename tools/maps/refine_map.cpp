// SPDX-License-Identifier: BSD-3-Clause
// refine_map: full bundle adjustment of a saved map, with parts of the rig free.
#include <fmt/format.h>
#include <glog/logging.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/saved_map.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/progress.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/command_line.h"
#include "given_rig.h"
#include "refine_in_rounds.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

constexpr double kDetermined = 0.5;  // posterior over prior deviation below which data tell
constexpr std::array kMeasured = {"u", "v", "disparity", "row"};
constexpr std::array kIncrement = {"rx", "ry", "rz", "tx", "ty", "tz"};

struct Arguments {
  fs::path input, output, calibration, json, covariances, from;
  double unit = 1;
  std::vector<std::string> free;
  int associations = 2;
  double hold_out = 0.1;
  std::int64_t seed = 1;
  bool covariance = false;
  bool quiet = false;
};

void declare(CLI::App& app, Arguments& a) {
  app.add_option("MAP", a.input, "map of a run (--save-map)")->required();
  one_at_a_time(app.add_option("-o,--output", a.output, "map to write"))->required();
  app.add_option(
         "--free", a.free,
         "parameters of the rig that are estimated: offset, intrinsics, baseline, rotation, "
         "distortion")
      ->delimiter(',');
  app.add_flag("--covariance", a.covariance, "covariances of keyframes, relative to the first");
  app.add_option("--associations", a.associations,
                 "with --free: times that observations are found anew, each with an adjustment")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  app.add_option("--hold-out", a.hold_out, "share of observations that are predicted, not used")
      ->check(finite_range(0, 0.5))
      ->capture_default_str();
  app.add_option("--seed", a.seed, "of the choice of these")
      ->check(whole_number(0))
      ->capture_default_str();
  one_at_a_time(app.add_option(
      "--calibration", a.calibration,
      "with --free: calibration to write (default: refined_calibration.yaml beside the map)"));
  one_at_a_time(app.add_option(
      "--from", a.from,
      "the rig's given calibration, when the images were raw; it goes into that file"));
  app.add_option("--calibration-unit", a.unit, "metres per unit of lengths in --from (mm: 0.001)")
      ->check(finite_range(1e-9, 1e6));
  one_at_a_time(app.add_option("--json", a.json,
                               "file for the figures (default: refinement.json beside the map)"));
  one_at_a_time(
      app.add_option("--covariances", a.covariances,
                     "with --covariance: their file (default: covariances.csv beside the map)"));
  app.add_flag("--quiet", a.quiet, "no progress");
}

void check(Arguments& a) {
  if (is_same_path(a.input, a.output)) throw InputError(a.output.string() + ": is the input");
  const auto beside = [&](fs::path& file, const char* name) {
    if (file.empty()) file = a.output.parent_path() / name;
    if (is_same_path(file, a.input)) throw InputError(file.string() + ": is the input");
    check_writable(file);
  };
  check_writable(a.output);
  beside(a.json, "refinement.json");
  if (!a.free.empty()) beside(a.calibration, "refined_calibration.yaml");
  if (a.covariance) beside(a.covariances, "covariances.csv");
}

double deviation(const RigEstimate& rig, int k) {
  return std::sqrt(std::max(0.0, rig.covariance(k, k)));
}

std::string residual_line(const char* name, const Residuals& r) {
  std::string text = fmt::format("  {:<34}", name);
  for (std::size_t c = 0; c < kMeasured.size(); ++c) {
    text += r.count.at(c) == 0 ? fmt::format(" {:>9}", "-")
                               : fmt::format(" {:>9.3f}", r.sigma[static_cast<Eigen::Index>(c)]);
  }
  return text + fmt::format(" {:>9}\n", r.count[0]);
}

std::string table(const RoundsResult& rounds, const RefinementOptions& options, bool any) {
  std::string text;
  const RefinementResult &result = rounds.last, &first = rounds.first;
  if (any) {
    text += fmt::format("{:<14} {:>11} {:>11} {:>11} {:>11}  {}\n", "parameter", "before", "after",
                        "sigma", "prior", "determined");
    for (int k = 0; k < RigCorrection::kSize; ++k) {
      const RigParameterName& name = rig_parameter_names().at(static_cast<std::size_t>(k));
      const double prior = std::sqrt(options.prior.covariance(k, k));
      const double sigma = deviation(result.after, k);
      const bool free = options.free.at(static_cast<std::size_t>(k));
      text += fmt::format("{:<14} {:>11.5f} {:>11.5f} {:>11.5f} {:>11.5f}  {}{}\n", name.name,
                          result.before.correction.parameters()[k],
                          result.after.correction.parameters()[k], sigma, prior,
                          !free                         ? "held"
                          : sigma < kDetermined * prior ? "yes"
                                                        : "no",
                          name.unit.empty() ? "" : fmt::format("  ({})", name.unit));
    }
    text += "\n";
  }
  text +=
      fmt::format("{:<36} {:>9} {:>9} {:>9} {:>9} {:>9}\n", "robust standard deviations, px/octave",
                  "u", "v", "disparity", "row", "number");
  using Part = Residuals RefinementResult::Stage::*;
  for (const auto& [name, part] : {std::pair<const char*, Part>("not used, only predicted",
                                                                &RefinementResult::Stage::held_out),
                                   {"used", &RefinementResult::Stage::used}}) {
    text += fmt::format("{}\n", name);
    text += residual_line("in the map as it was", first.read.*part);
    text +=
        residual_line(any ? "adjusted, correction as it was" : "adjusted", first.adjusted.*part);
    if (any) text += residual_line("adjusted with the correction", first.refined.*part);
    if (!rounds.associations.empty()) {
      text += residual_line("with observations found anew", result.refined.*part);
    }
  }
  return text;
}

nlohmann::json to_json(const Residuals& r) {
  nlohmann::json json{{"count", r.count[0]}};
  for (std::size_t c = 0; c < kMeasured.size(); ++c) {
    if (r.count.at(c) > 0) json[kMeasured.at(c)] = r.sigma[static_cast<Eigen::Index>(c)];
  }
  return json;
}

nlohmann::json figures(const Arguments& a, const MapObservations& map, const RoundsResult& rounds,
                       const RefinementOptions& options) {
  const RefinementResult &result = rounds.last, &first = rounds.first;
  nlohmann::json json{{"map", printable(a.input.string())},
                      {"keyframes", map.T_c_w.size()},
                      {"landmarks", map.landmarks.size()},
                      {"observations", result.observations},
                      {"free", a.free},
                      {"iterations", result.iterations},
                      {"complete", !result.stopped},
                      {"unit", result.unit}};
  for (const AssociationReport& r : rounds.associations) {
    json["associations"].push_back({{"dropped", r.dropped}, {"found", r.found}});
  }
  json["parameters"] = nlohmann::json::array();
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const RigParameterName& name = rig_parameter_names().at(static_cast<std::size_t>(k));
    const double prior = std::sqrt(options.prior.covariance(k, k));
    const bool free = options.free.at(static_cast<std::size_t>(k));
    json["parameters"].push_back(
        {{"name", name.name},
         {"unit", name.unit},
         {"before", result.before.correction.parameters()[k]},
         {"after", result.after.correction.parameters()[k]},
         {"sigma", deviation(result.after, k)},
         {"prior", prior},
         {"free", free},
         {"determined", free && deviation(result.after, k) < kDetermined * prior}});
  }
  for (const auto& [name, stage] : {std::pair("map", &first.read),
                                    {"adjusted", &first.adjusted},
                                    {"refined", &first.refined},
                                    {"found_anew", &result.refined}}) {
    json["residuals_px"][name] = {{"used", to_json(stage->used)},
                                  {"held_out", to_json(stage->held_out)}};
  }
  return json;
}

std::string covariance_table(const MapObservations& map, const RefinementResult& result) {
  std::string text =
      "# Covariance of the increment (rx, ry, rz: rad; tx, ty, tz: m) x_c -> exp(r) x_c + t of "
      "the\n"
      "# pose of a keyframe relative to keyframe `relative_to`, the first of its sub-map, in the\n"
      "# frame of its own left camera (x right, y down, z ahead). Upper triangle by rows.\n"
      "keyframe,timestamp_s,relative_to";
  for (std::size_t r = 0; r < 6; ++r) {
    for (std::size_t c = r; c < 6; ++c) {
      text += fmt::format(",{}_{}", kIncrement.at(r), kIncrement.at(c));
    }
  }
  text += "\n";
  for (std::size_t k = 0; k < map.T_c_w.size(); ++k) {
    std::uint32_t held = map.submaps[k];
    for (std::size_t j = 0; j < k; ++j) {
      if (map.held[j] != 0 && map.submaps[j] == map.submaps[k]) held = map.keyframe_ids[j];
    }
    if (map.held[k] != 0) held = map.keyframe_ids[k];
    text += fmt::format("{},{:.6f},{}", map.keyframe_ids[k], map.timestamps[k], held);
    for (Eigen::Index r = 0; r < 6; ++r) {
      for (Eigen::Index c = r; c < 6; ++c)
        text += fmt::format(",{:.9g}", result.covariances[k](r, c));
    }
    text += "\n";
  }
  return text;
}

int run(Arguments a) {
  RefinementOptions options;
  options.free = parse_groups(a.free);
  check(a);
  SavedMap map(a.input);
  MapSelection selection = MapSelection::all();
  if (!a.free.empty()) selection.coarsest_disparity = MapSelection().coarsest_disparity;
  MapObservations observations = map.observations(selection);
  const StereoRig rig = given_rig(a.from, a.unit, observations.camera);
  options.hold_out = a.hold_out;
  options.seed = static_cast<std::uint64_t>(a.seed);
  options.prior = {RigCorrection(observations.camera, RigCorrection::Parameters::Zero()),
                   rig_prior()};
  options.covariances = a.covariance;
  std::atomic<bool> stop{false};
  InterruptGuard guard([&] { stop = true; });
  options.watch.stop = &stop;
  RoundsResult rounds;
  {
    std::optional<Progress> progress;
    options.watch.progress = [&](int done, int most, const std::string& what) {
      if (!progress) {
        progress.emplace("iterations", most,
                         a.quiet ? Progress::Style::kNone : Progress::Style::kAuto);
      }
      progress->update(done, what);
    };
    rounds = refine_in_rounds(map, selection, options, a.free.empty() ? 0 : a.associations,
                              observations);
  }
  const RefinementResult& result = rounds.last;
  if (!observations.rig.correction.parameters().allFinite() ||
      !observations.rig.covariance.allFinite()) {
    throw InputError(a.input.string() + ": does not determine a calibration");
  }
  map.update(observations);
  map.write(a.output);
  if (!a.free.empty()) {
    write_file_atomic(a.calibration, to_yaml(rig) + to_yaml(CorrectionFile{observations.camera,
                                                                           observations.rig}));
  }
  if (a.covariance) write_file_atomic(a.covariances, covariance_table(observations, result));
  write_file_atomic(a.json, figures(a, observations, rounds, options).dump(2) + "\n");
  print_text(fmt::format("{} keyframes, {} landmarks, {} observations, {} iterations\n\n",
                         observations.T_c_w.size(), observations.landmarks.size(),
                         result.observations, result.iterations));
  print_text(table(rounds, options, !a.free.empty()));
  if (result.stopped) print_text("interrupted: this is the best so far\n");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  FLAGS_minloglevel = google::GLOG_FATAL;  // Ceres tells of every step that it refuses
  return kys_slam::run_main("refine_map", [&] {
    Arguments arguments;
    CLI::App app(
        "Bundle adjustment of all keyframes and landmarks of a saved map (Ceres), with parts of "
        "the rig's correction free. Writes the map, which runs continue (--load-map), the figures, "
        "and with --free a calibration that runs take (--calibration).",
        "refine_map");
    declare(app, arguments);
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    return run(arguments);
  });
}
