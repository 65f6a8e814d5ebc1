// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/read_ahead.h>
#include <kys_slam/sequence.h>
#include <kys_slam/system.h>
#include <kys_slam/util/progress.h>

#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "common/command_line.h"

namespace kys_slam {
namespace {

struct Arguments {
  std::filesystem::path sequence;
  std::filesystem::path priors;
  std::vector<std::string> modes{"stock", "stock", "kys"};
  std::vector<std::string> settings;
  std::int64_t frames = 0;
  int rounds = 3;
  bool quiet = false;
};

/// Sums over frames, ms; `compare` is the stages that compare descriptors on the tracking path.
struct Sums {
  double priors = 0, stereo = 0, track = 0, total = 0;
  double pairs = 0, inliers = 0;

  void add(const FrameReport& report) {
    priors += report.times.priors;
    stereo += report.times.stereo;
    track += report.times.track;
    total += report.times.total;
    pairs += static_cast<double>(report.statistics.total());
    inliers += report.inliers;
  }
  [[nodiscard]] double compare() const { return stereo + track; }
};

Settings settings_of(const Arguments& a, const std::string& mode) {
  Settings settings = is_euroc_folder(a.sequence) ? Settings::indoor() : Settings();
  for (const std::string& assignment : a.settings) settings.assign(assignment);
  settings.set("kys.mode", mode);
  settings.check();
  return settings;
}

std::unique_ptr<Sequence> open_frames(const Arguments& a) {
  SequenceOptions options;
  if (a.frames > 0) options.frames = a.frames;
  return open_sequence(a.sequence, options);
}

/// One pass over the sequence; every frame goes through all systems before the next is read, in an
/// order that moves on by one, so that all meet the same state of machine and caches.
std::int64_t one_round(const Arguments& a, std::vector<Sums>& sums, Progress& progress,
                       std::int64_t done) {
  const auto sequence = open_frames(a);
  std::vector<std::unique_ptr<System>> systems;
  for (const std::string& mode : a.modes) {
    const Settings settings = settings_of(a, mode);
    systems.push_back(std::make_unique<System>(
        sequence->camera(), settings, Schedule::kSequential,
        std::make_unique<PriorFolder>(
            a.priors, expected_priors(sequence->camera(), settings.get("control.label_space")))));
  }
  ReadAhead source(*sequence);
  while (const auto frame = source.next()) {
    for (std::size_t k = 0; k < systems.size(); ++k) {
      const std::size_t m = (k + static_cast<std::size_t>(done)) % systems.size();
      systems[m]->feed(*frame);
    }
    progress.update(++done);
  }
  for (std::size_t m = 0; m < systems.size(); ++m) {
    systems[m]->finish();
    for (const FrameReport& report : systems[m]->reports()) sums[m].add(report);
  }
  return done;
}

int compare(const Arguments& a) {
  std::vector<Sums> sums(a.modes.size());
  const std::int64_t total = open_frames(a)->frame_count() * a.rounds;
  Progress progress("comparing", total, a.quiet ? Progress::Style::kNone : Progress::Style::kAuto);
  std::int64_t done = 0;
  for (int round = 0; round < a.rounds; ++round) done = one_round(a, sums, progress, done);
  const auto n = static_cast<double>(done);
  fmt::print("ms per frame, means over {} frames; the last column is against the first row\n\n",
             done);
  fmt::print(
      "| mode | priors | stereo | track | stereo + track | total | pairs | inliers | stereo + "
      "track, share of total |\n");
  fmt::print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
  for (std::size_t m = 0; m < sums.size(); ++m) {
    const Sums& s = sums[m];
    fmt::print(
        "| {} | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {:.3f} | {:.0f} | {:.0f} | {:+.2f} % |\n",
        a.modes[m], s.priors / n, s.stereo / n, s.track / n, s.compare() / n, s.total / n,
        s.pairs / n, s.inliers / n, 100 * (s.compare() - sums[0].compare()) / sums[0].total);
  }
  return 0;
}

int run(int argc, char** argv) {
  CLI::App app{
      "Compares the tracking time of modes on the same frames in one run: each frame is fed to one "
      "system per mode, in turn. A mode given twice shows the measurement error."};
  Arguments a;
  app.add_option("SEQUENCE", a.sequence, "folder of the sequence")->required();
  app.add_option("--priors", a.priors, "folder of its prior files")->required();
  app.add_option("--modes", a.modes, "modes to compare with the first")->capture_default_str();
  one_at_a_time(
      app.add_option("--set", a.settings, "KEY=VALUE: one setting for all modes, may be repeated"));
  app.add_option("--frames", a.frames, "number of frames (default: all)")->check(whole_number(1));
  app.add_option("--rounds", a.rounds, "passes over the sequence")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_flag("--quiet", a.quiet, "no progress");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  return compare(a);
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("compare_mode_times", [&] { return kys_slam::run(argc, argv); });
}
