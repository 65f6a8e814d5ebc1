// SPDX-License-Identifier: BSD-3-Clause
// evaluate_estimates: disparity and flow that build_priors estimates from images against exact
// ones, by distance.
#include <kys/label_space.h>
#include <kys_slam/error.h>
#include <kys_slam/sequence.h>
#include <kys_slam/util/median.h>
#include <kys_slam/util/progress.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "priors/builder/estimators.h"
#include "priors/builder/options_file.h"
#include "priors/builder/seeded_flow.h"
#include "priors/input/field_input.h"
#include "priors/input/panoptic_input.h"

namespace kys_slam {
namespace {

constexpr std::array<double, 6> kDistance = {0,  10, 20,
                                             40, 80, std::numeric_limits<double>::infinity()};  // m
constexpr std::size_t kBins = kDistance.size() - 1;

struct Arguments {
  std::vector<std::string> sequences, settings;
  std::string config;
  int every = 8;
  std::int64_t frames = std::numeric_limits<std::int64_t>::max();
};

/// Errors of one estimate in one range of distance.
struct Errors {
  std::vector<float> px;
  std::int64_t pixels = 0;

  void add(float error) {
    ++pixels;
    if (std::isfinite(error)) px.push_back(error);
  }
};

/// By range of distance; stuff, things.
using Table = std::array<std::array<Errors, 2>, kBins>;

double share_above(const std::vector<float>& px, float limit) {
  const auto count = std::count_if(px.begin(), px.end(), [=](float e) { return e > limit; });
  return 100 * static_cast<double>(count) / static_cast<double>(px.size());
}

void print(const char* name, Table& table) {
  std::printf("\n%s\n%-10s %-7s %9s %8s %10s %8s %8s\n", name, "m", "", "pixels", "known %",
              "median px", "> 1 px %", "> 3 px %");
  for (std::size_t b = 0; b < kBins; ++b) {
    for (std::size_t thing = 0; thing < 2; ++thing) {
      Errors& e = table[b][thing];
      if (e.px.empty()) continue;
      const std::string range = std::isfinite(kDistance[b + 1])
                                    ? std::to_string(static_cast<int>(kDistance[b])) + "-" +
                                          std::to_string(static_cast<int>(kDistance[b + 1]))
                                    : "> " + std::to_string(static_cast<int>(kDistance[b]));
      const double known = 100 * static_cast<double>(e.px.size()) / static_cast<double>(e.pixels);
      const double above_1 = share_above(e.px, 1), above_3 = share_above(e.px, 3);
      std::printf("%-10s %-7s %9lld %8.1f %10.3f %8.2f %8.2f\n", range.c_str(),
                  thing != 0 ? "things" : "stuff", static_cast<long long>(e.pixels), known,
                  static_cast<double>(median(e.px)), above_1, above_3);
    }
  }
}

struct Tables {
  Table disparity, flow;
};

/// One sequence.
class Evaluation {
 public:
  Evaluation(const std::string& folder, const BuilderOptions& options, Tables& tables)
      : folder_(folder),
        options_(options),
        tables_(tables),
        sequence_(open_kitti_sequence(folder_)),
        labels_(kys::load_label_space("coco_panoptic_133")),
        reader_(folder_ / "panoptic_left", labels_) {}

  [[nodiscard]] std::int64_t frames() const { return sequence_->frame_count() - 1; }

  void add(std::int64_t t) {
    const StereoCamera& camera = sequence_->camera();
    const std::string& name = sequence_->frame(t).name;
    const StereoFrame frame = sequence_->read(t);
    const GrayImage &left = frame.left, &right = frame.right;
    const GrayImage next = sequence_->read(t + 1).left;
    const PanopticMap panoptic = reader_.read(name, camera.width, camera.height);
    const ImageOf<float> truth = read_disparity(find_disparity(folder_ / "disparity", name),
                                                FieldEncoding::kKitti, camera.bf());
    const FlowField flow_truth =
        read_flow(find_flow(folder_ / "flow_left", name), FieldEncoding::kKitti);
    ImageOf<float> disparity = estimate_disparity(left, right, false);
    check_left_right(disparity, estimate_disparity(left, right, true), -1,
                     options_.depth.left_right_tolerance);
    const FlowField flow = estimate_checked_flow(options_, camera, left, next, disparity,
                                                 panoptic.map, stuff_mask(panoptic));
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const float d = truth.at(x, y);
        const std::uint16_t segment = panoptic.map.at(x, y);
        if (!(d > 0) || segment == 0) continue;
        const double distance = camera.bf() / d;
        std::size_t bin = 0;
        while (distance >= kDistance[bin + 1]) ++bin;
        const std::size_t thing = panoptic.segments[segment - 1u].thing ? 1 : 0;
        tables_.disparity[bin][thing].add(std::abs(disparity.at(x, y) - d));
        const float u = flow_truth.u.at(x, y), v = flow_truth.v.at(x, y);
        if (!std::isfinite(u)) continue;
        tables_.flow[bin][thing].add(std::hypot(flow.u.at(x, y) - u, flow.v.at(x, y) - v));
      }
    }
  }

 private:
  std::filesystem::path folder_;
  const BuilderOptions& options_;
  Tables& tables_;
  std::unique_ptr<Sequence> sequence_;
  kys::LabelSpace labels_;
  PanopticReader reader_;
};

int run(int argc, char** argv) {
  CLI::App app(
      "Errors of the disparity and the flow that build_priors estimates (sgbm, dis), by distance: "
      "share of pixels with an estimate that passes its checks, median error, share of these with "
      "a larger error. For sequences of simulate_sequence with exact fields, all in one table.");
  Arguments a;
  app.add_option("sequence", a.sequences, "folders made by simulate_sequence")->required();
  app.add_option("--every", a.every, "every N-th frame")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  app.add_option("--frames", a.frames, "of the first N frames of each")->check(CLI::PositiveNumber);
  app.add_option("--config", a.config, "settings of build_priors (YAML)");
  one_at_a_time(
      app.add_option("--set", a.settings, "KEY=VALUE, overrides one setting; repeatable"));
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  BuilderOptions options;
  if (!a.config.empty()) load_options(a.config, options);
  for (const std::string& setting : a.settings) assign_option(options, setting);
  options.check();
  Tables tables;
  for (const std::string& sequence : a.sequences) {
    Evaluation evaluation(sequence, options, tables);
    const std::int64_t end = std::min(a.frames, evaluation.frames());
    Progress progress("frames", end);
    for (std::int64_t t = 0; t < end; t += a.every) {
      evaluation.add(t);
      progress.update(t + 1);
    }
  }
  print("disparity (sgbm)", tables.disparity);
  print("flow (dis)", tables.flow);
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_estimates", [&] { return kys_slam::run(argc, argv); });
}
