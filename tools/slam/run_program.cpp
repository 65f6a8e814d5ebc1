// SPDX-License-Identifier: BSD-3-Clause
#include "run_program.h"

#include <fmt/format.h>
#include <kys/mode_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/pair_watch.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/read_ahead.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_writer.h>
#include <kys_slam/system.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <kys_slam/util/memory.h>
#include <kys_slam/util/memory_limit.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/process_figures.h>
#include <kys_slam/util/progress.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/stopwatch.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/command_line.h"
#include "frame_priors.h"

namespace kys_slam {

namespace {

struct Arguments {
  std::filesystem::path sequence;
  std::filesystem::path priors;
  std::string mode;
  std::filesystem::path calibration;
  std::filesystem::path config;
  std::vector<std::string> settings;
  std::filesystem::path output;
  std::string schedule = "pipelined";
  std::string pair;
  std::optional<double> tolerance;
  std::vector<std::filesystem::path> masks;
  std::int64_t start = 0;
  std::optional<std::int64_t> frames;
  bool quiet = false;
  bool strict_priors = false;
  std::filesystem::path load_map;
  std::filesystem::path save_map;
  bool localize_only = false;
  bool list_settings = false;
  bool overwrite = false;
  std::string log_level = "info";
};

void declare(CLI::App& app, Arguments& a) {
  std::string modes;
  for (const kys::Mode mode : kys::all_modes()) {
    modes += (modes.empty() ? "" : ", ") + std::string(kys::mode_name(mode));
  }
  app.add_option("SEQUENCE", a.sequence,
                 "folder of the sequence, or a feature file (simulate_features)");
  CLI::Option* priors =
      app.add_option("--priors", a.priors,
                     "folder of this sequence's prior files (a feature file may contain its own)");
  app.add_option("--mode", a.mode,
                 "matching mode: " + modes + " (default: verified with priors, stock without)");
  app.add_option("--calibration", a.calibration,
                 "file with a correction of the sequence's calibration (calibrate_rig): the run "
                 "begins with it");
  app.add_option("--config", a.config, "YAML file of settings; every setting has a default");
  one_at_a_time(app.add_option("--set", a.settings, "KEY=VALUE: one setting, may be repeated"));
  app.add_flag("--list-settings", a.list_settings,
               "print every setting with unit, meaning and range, and exit");
  app.add_option("--output", a.output, "folder for the results (default: runs/<sequence>-<mode>)");
  app.add_flag("--overwrite", a.overwrite,
               "allow an output folder with the run of another sequence, recording or mode");
  app.add_option(
         "--schedule", a.schedule,
         "pipelined: mapping in parallel with tracking, reproducible; sequential: mapping after "
         "tracking of each frame, reproducible; realtime: frames at the pace of their time stamps")
      ->capture_default_str();
  app.add_option("--pair", a.pair,
                 "cameras of a KITTI odometry sequence: grey (image_0, image_1; default if they "
                 "exist) or colour (image_2, image_3)")
      ->check(CLI::IsMember({"grey", "colour"}));
  app.add_option(
         "--tolerance", a.tolerance,
         "s, largest time difference of the images of a pair (EuRoC, TUM-VI; default: 0.003)")
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option(
         "--mask", a.masks,
         "8-bit PNG of what no frame uses (the robot itself), 0 = use: of the left camera, or "
         "of both")
      ->expected(1, 2);
  app.add_option("--start", a.start, "first frame, from 0")->check(whole_number(0));
  app.add_option("--frames", a.frames, "number of frames (default: to the end)")
      ->check(whole_number(1));
  app.add_flag("--strict-priors", a.strict_priors, "a missing prior file is an error")
      ->needs(priors);
  app.add_option("--load-map", a.load_map, "continue with this map");
  app.add_option("--save-map", a.save_map, "write the map to this file at the end");
  app.add_flag("--localize-only", a.localize_only,
               "track in the map of --load-map without changing it");
  app.add_flag("--quiet", a.quiet, "no progress, no table");
  app.add_option("--log-level", a.log_level, "trace, debug, info, warn, error, off")
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
}

/// The default mode depends on the priors, and the default label space is theirs; what is named
/// anywhere takes their place.
Settings effective_settings(Settings settings, const Arguments& a, bool with_priors) {
  if (with_priors) settings.set("kys.mode", "verified");
  if (!a.priors.empty()) {
    const std::string label_space = label_space_of_priors(a.priors);
    if (!label_space.empty()) settings.set("control.label_space", label_space);
  }
  if (!a.config.empty()) settings.load(a.config);
  for (const std::string& assignment : a.settings) settings.assign(assignment);
  if (!a.mode.empty()) settings.set("kys.mode", a.mode);
  settings.check();
  const std::string mode = settings.get("kys.mode");
  if (!with_priors && kys::needs_priors(kys::parse_mode(mode))) {
    throw InputError("mode " + mode +
                     " needs priors: give --priors DIR (build_priors makes them), or --mode stock");
  }
  return settings;
}

/// What went wrong; the run goes on to save what there is.
class Failures {
 public:
  explicit Failures(RunInfo& info) : info_(info) {}

  /// Runs one step; what it throws is noted, the first in `info`.
  template <typename Step>
  void guard(Step&& step) {
    try {
      step();
    } catch (...) {
      reserve_.release();
      const Failure failure = describe_failure(std::current_exception());
      if (status_ == 0) status_ = failure.status;
      if (std::find(messages_.begin(), messages_.end(), failure.message) == messages_.end()) {
        messages_.push_back(failure.message);
      }
      if (info_.complete) info_.end_reason = failure.message;
      info_.complete = false;
    }
  }

  [[nodiscard]] int status() const { return status_; }
  void print(const std::string& program) const {
    for (const std::string& message : messages_) print_failure(program, {status_, message});
  }

 private:
  RunInfo& info_;
  MemoryReserve reserve_;  // to save with, when memory runs out
  int status_ = 0;
  std::vector<std::string> messages_;
};

/// When frames are due at the camera's pace. A stall comes on top of every frame, as a slow driver
/// would add it: the back end gains that time, it does not vanish in the wait for the next frame.
struct Pace {
  bool on = false;
  double stall_ms = 0;

  [[nodiscard]] double due_ms(double seconds, std::int64_t frames_before) const {
    return 1000 * seconds + stall_ms * static_cast<double>(frames_before);
  }
};

/// Feeds frames until the end or an interrupt, which is noted in `info`.
void feed_all(System& system, FrameSource& source, const StereoMasks& masks,
              std::optional<std::int64_t> total, bool quiet, const Pace& pace,
              InterruptGuard& guard, RunInfo& info) {
  Progress progress("tracking", total, quiet ? Progress::Style::kNone : Progress::Style::kAuto);
  std::int64_t done = 0;
  std::set<std::string> reported;  // each warning once; summary.json has how often
  Stopwatch clock;
  std::optional<double> first_time;
  while (std::optional<StereoFrame> frame = source.next()) {
    if (guard.requested()) {
      info.complete = false;
      info.end_reason = "interrupted";
      return;
    }
    if (pace.on) {
      if (!first_time) first_time = frame->timestamp;
      const double due_ms = pace.due_ms(frame->timestamp - *first_time, done);
      guard.wait_for(std::chrono::duration<double, std::milli>(due_ms - clock.elapsed_ms()));
    }
    const FrameReport report = system.feed(*frame, masks);
    if (report.status == FrameStatus::kLost) {
      spdlog::debug("frame {} lost: {}", report.index, report.reason);
    }
    if (!report.warning.empty() && reported.insert(report.warning).second) {
      spdlog::warn("frame {}: {}", report.index, printable(report.warning));
    }
    progress.update(++done);
    check_memory_in_use(report.resident_mb);
  }
}

/// To the end of the frames, and of what the back end still has in hand.
void track(System& system, FrameSource& frames, const StereoMasks& masks, const Arguments& a,
           const Pace& pace, const Stopwatch& start_up, InterruptGuard& guard, RunInfo& info,
           Failures& failures) {
  const double cpu_before = process_figures().cpu_seconds();
  info.start_up_s = start_up.elapsed_ms() / 1000;
  const Stopwatch wall;
  failures.guard([&] {
    ReadAhead source(frames);
    feed_all(system, source, masks, frames.size(), a.quiet, pace, guard, info);
  });
  failures.guard([&] {
    const Waiting waiting("finishing the map",
                          a.quiet ? Progress::Style::kNone : Progress::Style::kAuto);
    system.finish();
    if (guard.requested() && info.complete) {  // the last optimisation was left out
      info.complete = false;
      info.end_reason = "interrupted";
    }
  });
  info.wall_s = wall.elapsed_ms() / 1000;
  info.cpu_s = process_figures().cpu_seconds() - cpu_before;
}

/// Whether both are known, begin with the same frame, and are not of the same recording.
bool are_of_two_recordings(const std::string& a, const std::string& b) {
  const std::size_t colon = a.find(':');
  return colon != std::string::npos && b.starts_with(a.substr(0, colon + 1)) && a != b;
}

/// A second run of the same sequence and mode takes the place of the first; another one's results
/// are not overwritten by mistake.
void check_not_of_another_run(const std::filesystem::path& output, const RunInfo& info) {
  const std::filesystem::path file = output / "summary.json";
  if (!path_exists(file)) return;
  const auto summary =
      nlohmann::json::parse(read_text(file, std::size_t{16} << 20), nullptr, false);
  const auto text = [&](const char* key) {
    const auto found = summary.is_object() ? summary.find(key) : summary.end();
    return found != summary.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  const std::string sequence = text("sequence");
  const std::string mode = text("mode");
  const bool other = are_of_two_recordings(text("recording"), info.recording);
  if (sequence == printable(info.sequence) && mode == info.mode && !other) return;
  throw InputError(
      fmt::format("{}: holds another run (sequence '{}', mode '{}'{}); --overwrite, or "
                  "another --output",
                  output.string(), sequence, mode, other ? ", another recording" : ""));
}

/// Where priors come from, and how many frames had none.
struct Priors {
  std::unique_ptr<PriorProvider> provider;  ///< null: there are none
  std::function<std::int64_t()> missing;    ///< as long as the provider lives
};

template <typename Provider>
Priors counted(std::unique_ptr<Provider> provider) {
  const Provider* counts = provider.get();
  return {std::move(provider), [counts] { return counts->missing(); }};
}

/// From the folder given, or from the frames of a feature file.
Priors open_priors(const Arguments& a, const FrameInput& input, const Settings& settings) {
  if (!a.priors.empty()) {
    return counted(std::make_unique<PriorFolder>(
        a.priors, expected_priors(input.frames->camera(), settings.get("control.label_space")),
        a.strict_priors,
        [](const std::string& message) { spdlog::warn("{}", printable(message)); }));
  }
  if (!input.label_space.empty()) return counted(std::make_unique<FramePriors>());
  return {};
}

/// Of a path that is no sequence: what is often given in its place.
/// \throws InputError that says the right way
void explain_mistake(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::string ending = path.extension().string();
  for (const char* recording : {".mp4", ".avi", ".mkv", ".mov", ".bag", ".mcap", ".db3"}) {
    if (ending != recording) continue;
    throw InputError(name + ": videos and ROS bags are read by kys-slam run (python/README.md)");
  }
  if (ending == ".kysp") {
    throw InputError(name + ": a prior file; give the sequence, and its folder to --priors");
  }
  std::error_code ignored;
  if (std::filesystem::exists(path / "summary.json", ignored) &&
      std::filesystem::exists(path / "trajectory.tum", ignored)) {
    throw InputError(name + ": the results of a run; evaluate_trajectory reads them");
  }
  for (std::filesystem::path above = std::filesystem::absolute(path, ignored);
       above.has_relative_path(); above = above.parent_path()) {
    if (above.filename() != "mav0") continue;
    throw InputError(name + ": a part of a sequence in EuRoC's layout; give " +
                     above.parent_path().string() + " to run_stereo_euroc");
  }
  for (std::filesystem::directory_iterator i(path, ignored), end; !ignored && i != end;
       i.increment(ignored)) {
    if (i->path().extension() != ".kysp") continue;
    throw InputError(name + ": prior files; give the sequence, and these to --priors");
  }
}

/// A run that ended before its first keyframe has no map, and leaves one that exists as it is.
void save_map(const System& system, const RunOutcome& outcome, const std::filesystem::path& file,
              const std::filesystem::path& output) {
  if (outcome.keyframes_made == 0 && system.snapshot().keyframes.empty()) {
    spdlog::warn("{}: no map is written, since this run has no keyframes",
                 printable(file.string()));
    return;
  }
  save_map_or_beside(system, file, output);
}

/// The same of results and a run that ended before its first frame.
/// \returns whether there are results of this run
bool write_results(const System& system, const Settings& settings, Schedule schedule,
                   const RunInfo& info, const RunOutcome& outcome,
                   const std::filesystem::path& output) {
  if (system.reports().empty() && path_exists(output / "summary.json")) {
    spdlog::warn("the results in {} are left as they were: this run has no frames",
                 printable(output.string()));
    return false;
  }
  write_run(output, system, settings, schedule, info, outcome);
  return true;
}

/// A sequence with something wrong in it gets that message, also where other files are in its
/// folder.
bool looks_like_sequence(const std::filesystem::path& path) {
  std::error_code ignored;
  for (const char* part : {"image_0", "image_2", "frames", "mav0", "cam0"}) {
    if (std::filesystem::is_directory(path / part, ignored)) return true;
  }
  return false;
}

FrameInput open_input(const RunProgram& program, const Arguments& a) {
  SequenceOptions options;
  options.start = a.start;
  options.frames = a.frames;
  options.pair = parse_camera_pair(a.pair);
  if (a.tolerance) options.pairing_tolerance = *a.tolerance;
  try {
    FrameInput input = open_frame_input(a.sequence, options, program.open);
    const auto* sequence = dynamic_cast<const Sequence*>(input.frames.get());
    if (a.tolerance && (sequence == nullptr || !sequence->paired_by_time())) {
      throw InputError(a.sequence.string() +
                       ": images are paired by number, --tolerance does not apply");
    }
    return input;
  } catch (const InputError&) {
    if (!looks_like_sequence(a.sequence)) explain_mistake(a.sequence);
    throw;
  }
}

/// Masks of all frames; empty ones use all pixels.
StereoMasks read_masks(const std::vector<std::filesystem::path>& files,
                       const StereoCamera& camera) {
  std::array<GrayImage, 2> masks;
  for (std::size_t i = 0; i < files.size(); ++i) {
    masks[i] = read_indexed(files[i]);
    if (masks[i].width() == camera.width && masks[i].height() == camera.height) continue;
    throw InputError(fmt::format("{}: a mask of {}x{} px; images are {}x{}", files[i].string(),
                                 masks[i].width(), masks[i].height(), camera.width, camera.height));
  }
  return {std::move(masks[0]), std::move(masks[1])};
}

int run(const RunProgram& program, const Arguments& a) {
  const Stopwatch start_up;
  const Schedule schedule = parse_schedule(a.schedule);
  const FrameInput input = open_input(program, a);
  const Settings settings =
      effective_settings(program.settings, a, !a.priors.empty() || !input.label_space.empty());
  check_features(input, settings, a.sequence);

  RunInfo info;
  info.sequence = input.name;
  info.mode = settings.get("kys.mode");
  info.recording = input.recording;
  info.ground_truth = input.ground_truth;
  info.left_out = input.left_out;
  info.warnings = input.notes;
  for (const std::string& note : input.notes) spdlog::warn("{}", printable(note));
  const StereoMasks masks = read_masks(a.masks, input.frames->camera());
  const std::filesystem::path output =
      a.output.empty() ? std::filesystem::path("runs") / (info.sequence + "-" + info.mode)
                       : a.output;
  if (!a.overwrite) check_not_of_another_run(output, info);
  make_output_folder(output);
  if (!a.save_map.empty()) {
    if (is_same_path(a.save_map, a.sequence)) {
      throw InputError("--save-map " + a.save_map.string() + ": is the input");
    }
    check_writable(a.save_map);
  }
  Priors priors = open_priors(a, input, settings);

  System system(input.frames->camera(), settings, schedule, std::move(priors.provider));
  if (!a.calibration.empty()) {
    system.start_rig(read_rig_correction(a.calibration, input.frames->camera()));
  }
  if (!a.load_map.empty()) system.load_map(a.load_map, a.localize_only);
  Failures failures(info);
  const Pace pace{schedule == Schedule::kRealtime, std::stod(settings.get("control.stall_ms"))};
  InterruptGuard guard([&] { system.interrupt(); });
  PairWatch watched(*input.frames,
                    [](const std::string& warning) { spdlog::warn("{}", printable(warning)); });
  track(system, watched, masks, a, pace, start_up, guard, info, failures);
  if (!watched.warning().empty()) info.warnings.push_back(watched.warning());
  if (priors.missing) info.missing_priors = priors.missing();
  RunOutcome outcome;
  failures.guard([&] { outcome = summarise_run(system, info); });
  bool has_results = true;
  failures.guard(
      [&] { has_results = write_results(system, settings, schedule, info, outcome, output); });
  if (!a.save_map.empty()) {
    failures.guard([&] { save_map(system, outcome, a.save_map, output); });
  }
  if (!a.quiet && has_results) {
    failures.guard([&] {
      print_text(describe_run(system, info, outcome) +
                 fmt::format("\nresults in {}\n", printable(output.string())));
    });
  }
  failures.print(program.name);
  if (failures.status() != 0) return failures.status();
  const std::string failure = describe_failure_to_track(system, outcome);
  if (outcome.trajectory.empty() || failure.empty()) return 0;
  fmt::print(stderr, "{}: {}\n", program.name, failure);
  return kTrackingFailed;
}

}  // namespace

int run_program(RunProgram program, int argc, char** argv) {
  keep_freed_memory(4 << 20);  // images, not what bundle adjustment of a whole map takes
  return run_main(program.name, [&] {
    Arguments arguments;
    CLI::App app(program.description, program.name);
    declare(app, arguments);
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    if (arguments.list_settings) {
      print_text(program.settings.to_yaml());
      return 0;
    }
    if (arguments.localize_only && arguments.load_map.empty()) {
      throw InputError("--localize-only needs --load-map");
    }
    if (!arguments.calibration.empty() && !arguments.load_map.empty()) {
      throw InputError("--calibration with --load-map: the map has its own correction");
    }
    if (arguments.sequence.empty()) throw InputError("SEQUENCE is missing; see --help");
    spdlog::set_default_logger(spdlog::stderr_color_mt(program.name));
    spdlog::set_level(spdlog::level::from_str(arguments.log_level));
    return run(program, arguments);
  });
}

}  // namespace kys_slam
