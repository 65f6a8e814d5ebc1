// SPDX-License-Identifier: BSD-3-Clause
// calibrate_rig: the correction of a rig's calibration from the maps of several recordings.
#include <fmt/format.h>
#include <glog/logging.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/rig_rows.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/progress.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "calibration.h"
#include "common/command_line.h"
#include "given_rig.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

constexpr std::size_t kMostObservations = 120000;  // of all maps: about a second an iteration
constexpr std::size_t kMostPerMap = 30000;
constexpr std::size_t kLeastObservations = 300;
constexpr double kDetermined = 0.5;  // posterior over prior deviation below which data tell

constexpr std::array kMeasured = {"u", "v", "disparity", "row"};

struct Arguments {
  std::vector<fs::path> maps;
  fs::path output;
  fs::path from;
  double unit = 1;
  fs::path shape;
  fs::path json;
  double hold_out = 0.1;
  std::int64_t seed = 1;
  bool quiet = false;
};

void declare(CLI::App& app, Arguments& a) {
  app.add_option("MAP", a.maps, "maps of recordings of one rig (--save-map)")->required();
  one_at_a_time(app.add_option("-o,--output", a.output, "calibration file to write"))->required();
  one_at_a_time(app.add_option(
      "--from", a.from,
      "the rig's given calibration, when the images were raw; it goes into the output"));
  app.add_option("--calibration-unit", a.unit, "metres per unit of lengths in --from (mm: 0.001)")
      ->check(finite_range(1e-9, 1e6));
  one_at_a_time(
      app.add_option("--keep-shape", a.shape,
                     "an earlier output: what is common to all recordings stays as in it"));
  app.add_option("--hold-out", a.hold_out, "share of observations that are predicted, not used")
      ->check(finite_range(0, 0.5))
      ->capture_default_str();
  app.add_option("--seed", a.seed, "of the choice of these")
      ->check(whole_number(0))
      ->capture_default_str();
  one_at_a_time(app.add_option("--json", a.json, "file for the figures"));
  app.add_flag("--quiet", a.quiet, "no progress");
}

std::vector<Recording> read_maps(const Arguments& a) {
  MapSelection selection;
  selection.observations = std::min(kMostPerMap, kMostObservations / a.maps.size());
  std::vector<Recording> recordings;
  Progress progress("maps", static_cast<std::int64_t>(a.maps.size()),
                    a.quiet ? Progress::Style::kNone : Progress::Style::kAuto);
  for (const fs::path& path : a.maps) {
    for (std::size_t k = 0; k < recordings.size(); ++k) {
      if (is_same_path(path, a.maps[k])) throw InputError(path.string() + ": is given twice");
    }
    if (is_same_path(path, a.output)) throw InputError(path.string() + ": is input and output");
    Recording recording{path.string(), read_map_observations(path, selection)};
    if (recording.map.observations.size() < kLeastObservations) {
      throw InputError(
          fmt::format("{}: shows too little: {} observations of landmarks that three "
                      "keyframes see; {} are needed",
                      path.string(), recording.map.observations.size(), kLeastObservations));
    }
    if (!recordings.empty() && !(recording.map.camera == recordings.front().map.camera)) {
      throw InputError(fmt::format("{}: of another camera ({}) than {} ({})", path.string(),
                                   describe(recording.map.camera), recordings.front().name,
                                   describe(recordings.front().map.camera)));
    }
    recordings.push_back(std::move(recording));
    progress.update(static_cast<std::int64_t>(recordings.size()));
  }
  return recordings;
}

struct Line {
  std::string name;
  std::string unit;
  double before = 0, after = 0, sigma = 0, prior = 0;
  [[nodiscard]] bool determined() const { return sigma < kDetermined * prior; }
};

std::string file_name(const Recording& recording) {
  return fs::path(recording.name).filename().string();
}

/// The shape's parameters, then those of every recording.
std::vector<Line> lines_of(const CalibrationResult& result, const CalibrationOptions& options,
                           const std::vector<Recording>& recordings) {
  std::vector<Line> lines;
  const auto add = [&](int place, const std::string& of, const RigEstimate& rig) {
    const RigParameterName& name = rig_parameter_names().at(static_cast<std::size_t>(place));
    lines.push_back({std::string(name.name) + of, std::string(name.unit), 0,
                     rig.correction.parameters()[place],
                     std::sqrt(std::max(0.0, rig.covariance(place, place))),
                     std::sqrt(options.prior(place, place))});
  };
  for (const int place : shape_places()) add(place, "", result.recordings.front().rig);
  for (std::size_t m = 0; m < recordings.size(); ++m) {
    const std::string of = " of " + file_name(recordings[m]);
    for (const int place : own_places()) add(place, of, result.recordings[m].rig);
  }
  return lines;
}

std::string table(const std::vector<Line>& lines, const CalibrationResult& result,
                  const std::vector<Recording>& recordings) {
  std::string text = fmt::format("{:<32} {:>10} {:>11} {:>11} {:>11}  {}\n", "parameter", "before",
                                 "after", "sigma", "prior", "determined");
  for (const Line& line : lines) {
    text += fmt::format("{:<32} {:>10} {:>11.5f} {:>11.5f} {:>11.5f}  {}{}\n", printable(line.name),
                        line.before, line.after, line.sigma, line.prior,
                        line.determined() ? "yes" : "no",
                        line.unit.empty() ? "" : "  (" + line.unit + ")");
  }
  text += "\nrobust standard deviations of observations that were not used, px of their octave\n";
  for (std::size_t m = 0; m < recordings.size(); ++m) {
    const RecordingResult& r = result.recordings[m];
    text +=
        fmt::format("{}: {} keyframes, {} landmarks, {} observations\n",
                    printable(file_name(recordings[m])), r.keyframes, r.landmarks, r.observations);
    for (const auto& [name, held] : {std::pair("before", &r.before), {"after", &r.after}}) {
      text += fmt::format("  {:<7}", name);
      for (std::size_t c = 0; c < 4; ++c) {
        text += fmt::format(" {} {}", kMeasured.at(c),
                            held->count.at(c) == 0
                                ? "-"
                                : fmt::format("{:.3f}", held->sigma[static_cast<Eigen::Index>(c)]));
      }
      text += fmt::format("  (of {})\n", held->count[0]);
    }
  }
  return text;
}

nlohmann::json figures(const std::vector<Line>& lines, const CalibrationResult& result,
                       const std::vector<Recording>& recordings) {
  nlohmann::json json;
  json["iterations"] = result.iterations;
  json["complete"] = !result.stopped;
  json["unit"] = result.unit;
  for (const Line& line : lines) {
    json["parameters"].push_back({{"name", printable(line.name)},
                                  {"unit", line.unit},
                                  {"before", line.before},
                                  {"after", line.after},
                                  {"sigma", line.sigma},
                                  {"prior", line.prior},
                                  {"determined", line.determined()}});
  }
  for (std::size_t m = 0; m < recordings.size(); ++m) {
    const RecordingResult& r = result.recordings[m];
    nlohmann::json one{{"map", printable(recordings[m].name)},
                       {"keyframes", r.keyframes},
                       {"landmarks", r.landmarks},
                       {"observations", r.observations},
                       {"held_out", r.after.count[0]}};
    for (std::size_t c = 0; c < 4; ++c) {
      if (r.after.count.at(c) == 0) continue;
      one["before"][kMeasured.at(c)] = r.before.sigma[static_cast<Eigen::Index>(c)];
      one["after"][kMeasured.at(c)] = r.after.sigma[static_cast<Eigen::Index>(c)];
    }
    json["maps"].push_back(one);
  }
  return json;
}

int run(const Arguments& a) {
  check_writable(a.output);
  if (!a.json.empty()) check_writable(a.json);
  std::vector<Recording> recordings = read_maps(a);
  const StereoCamera camera = recordings.front().map.camera;
  const StereoRig rig = given_rig(a.from, a.unit, camera);
  CalibrationOptions options;
  options.hold_out = a.hold_out;
  options.seed = static_cast<std::uint64_t>(a.seed);
  options.prior = rig_prior();
  if (!a.shape.empty()) {
    options.start = read_rig_correction(a.shape, camera).correction.parameters();
    for (const int place : own_places()) options.start[place] = 0;
    options.keep_shape = true;
  }
  std::atomic<bool> stop{false};
  InterruptGuard guard([&] { stop = true; });
  options.watch.stop = &stop;
  CalibrationResult result;
  {
    std::optional<Progress> progress;
    options.watch.progress = [&](int done, int most, const std::string& what) {
      if (!progress) {
        progress.emplace("iterations", most,
                         a.quiet ? Progress::Style::kNone : Progress::Style::kAuto);
      }
      progress->update(done, what);
    };
    result = calibrate(recordings, options);
  }
  const RigEstimate estimate = result.estimate(camera, options.prior);
  if (!estimate.correction.parameters().allFinite() || !estimate.covariance.allFinite()) {
    throw InputError("the maps do not determine a calibration");
  }
  const std::vector<Line> lines = lines_of(result, options, recordings);
  write_file_atomic(a.output, to_yaml(rig) + to_yaml(CorrectionFile{camera, estimate}));
  if (!a.json.empty()) {
    write_file_atomic(a.json, figures(lines, result, recordings).dump(2) + "\n");
  }
  print_text(table(lines, result, recordings));
  if (result.stopped) print_text("interrupted: this is the best so far\n");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  FLAGS_minloglevel = google::GLOG_FATAL;  // Ceres tells of every step that it refuses
  return kys_slam::run_main("calibrate_rig", [&] {
    Arguments arguments;
    CLI::App app(
        "Estimates how a stereo rig differs from its given calibration, from the maps of several "
        "recordings: lenses, focal lengths, yaw and baseline common to all, pitch, roll, offset of "
        "disparities and of rows of each. Writes the calibration with this correction.",
        "calibrate_rig");
    declare(app, arguments);
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    return run(arguments);
  });
}
