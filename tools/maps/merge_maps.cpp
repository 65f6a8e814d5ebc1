// SPDX-License-Identifier: BSD-3-Clause
// merge_maps: two maps of one place become one.
#include <fmt/format.h>
#include <glog/logging.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/saved_map.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/interrupt.h>
#include <kys_slam/util/paths.h>

#include <algorithm>

#include "common/command_line.h"
#include "refinement.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

constexpr int kNoOverlap = 3;  // exit status

int run(const std::vector<fs::path>& inputs, const fs::path& output, bool refined) {
  for (const fs::path& input : inputs) {
    if (is_same_path(input, output)) throw InputError(output.string() + ": is an input");
  }
  if (is_same_path(inputs[0], inputs[1])) throw InputError(inputs[1].string() + ": is given twice");
  check_writable(output);
  SavedMap map(inputs[0]);
  const SavedMap other(inputs[1]);
  std::atomic<bool> stop{false};
  const InterruptGuard guard([&] { stop = true; });
  const MergeReport report = map.merge(other, &stop);
  if (stop) throw InputError("interrupted; nothing is written");
  const std::string tried =
      fmt::format("{} keyframes of {} compared, {} candidate places verified", report.keyframes,
                  printable(inputs[1].string()), report.candidates);
  if (!report.merged) {
    print_text("no common place found: " + tried + "; nothing is written\n");
    return kNoOverlap;
  }
  RefinementResult result;
  if (refined) {
    MapObservations observations = map.observations();
    RefinementOptions options;
    options.hold_out = 0;
    options.prior = {RigCorrection(observations.camera, RigCorrection::Parameters::Zero()),
                     rig_prior()};
    options.watch.stop = &stop;
    result = refine(observations, options);
    map.update(observations);
  }
  map.write(output);
  const auto joins = std::count_if(report.places.begin(), report.places.end(),
                                   [](const MergeReport::Place& p) { return p.joined; });
  const MapSnapshot merged = map.snapshot();
  print_text(
      fmt::format("{}: {} common places found, sub-maps joined {} times, {} landmarks "
                  "became one\n{} keyframes, {} landmarks",
                  tried, report.places.size(), joins, report.fused, merged.keyframes.size(),
                  merged.landmarks.size()));
  if (refined) {
    print_text(
        fmt::format("; residuals of u {:.3f} to {:.3f} px, of disparities {:.3f} to {:.3f} px "
                    "by bundle adjustment",
                    result.read.used.sigma[0], result.refined.used.sigma[0],
                    result.read.used.sigma[2], result.refined.used.sigma[2]));
  }
  print_text("\n");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  FLAGS_minloglevel = google::GLOG_FATAL;
  return kys_slam::run_main("merge_maps", [&] {
    CLI::App app(
        "Joins two saved maps of one place, of one rig: finds common places as a run finds loops, "
        "joins the maps there, and adjusts all of it. Exit status 3 when there is no common place; "
        "nothing is written then.",
        "merge_maps");
    std::vector<fs::path> inputs;
    fs::path output;
    bool plain = false;
    app.add_option("MAP", inputs, "two maps of runs (--save-map)")->required()->expected(2);
    one_at_a_time(app.add_option("-o,--output", output, "map to write"))->required();
    app.add_flag("--no-adjustment", plain, "no bundle adjustment at the end");
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    return run(inputs, output, !plain);
  });
}
