// SPDX-License-Identifier: BSD-3-Clause
// build_priors: perception outputs of a sequence in, prior files out.
#include <kys_slam/error.h>
#include <kys_slam/util/memory.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <optional>

#include "common/command_line.h"
#include "open_sequence.h"
#include "priors/builder/build_sequence.h"
#include "priors/builder/options_file.h"

namespace {

using namespace kys_slam;

struct Arguments {
  std::string sequence, panoptic[2], semantic[2], config, pair, label_space = "coco_panoptic_133";
  std::vector<std::string> set, flow;
  BuildInputs inputs;
  BuildSettings settings;
  std::int64_t start = 0;
  std::optional<std::int64_t> frames;
  bool check = false, quiet = false;
};

void declare(CLI::App& app, Arguments& a) {
  app.add_option("sequence", a.sequence, "Sequence folder")->required();
  app.add_option("--panoptic-left", a.panoptic[0],
                 "Panoptic maps of the left camera: COCO PNGs with DIR.json, two-channel PNGs, or "
                 "Virtual KITTI 2's instanceSegmentation/Camera_0 (classes in classSegmentation)");
  app.add_option("--panoptic-right", a.panoptic[1], "The same of the right camera");
  app.add_option(
      "--semantic-left", a.semantic[0],
      "Instead of panoptic maps: 8-bit class maps (category ids; 255 is void, and 0 unless the "
      "label space has a class 0); no instances, no motion");
  app.add_option("--semantic-right", a.semantic[1], "The same of the right camera");
  CLI::Option* disparity =
      app.add_option("--disparity", a.inputs.disparity,
                     "Left disparity: folder of KITTI PNG, PFM or NPY; or 'sgbm' to estimate it");
  app.add_option("--disparity-right", a.inputs.disparity_right,
                 "Right disparity, folder (default: the left one is warped)")
      ->needs(disparity);
  app.add_option("--flow-left", a.inputs.flow[0],
                 "Flow to the next frame, left: folder of KITTI PNG, .flo or NPY; or 'dis'");
  app.add_option("--flow-right", a.inputs.flow[1], "The same of the right camera");
  app.add_option("--flow", a.flow,
                 "'keypoints': also judge motion by stereo keypoints tracked over time "
                 "(detection.method: robust); 'dis': estimate the flow of both cameras")
      ->check(CLI::IsMember({"keypoints", "dis"}))
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->delimiter(',');
  app.add_option("--flow-back-left", a.inputs.flow_back[0],
                 "Backward flow, for the consistency check (file of frame t: from "
                 "t+1 to t; with vkitti encoding the file of t+1)");
  app.add_option("--flow-back-right", a.inputs.flow_back[1], "The same of the right camera");
  app.add_option("--output", a.settings.output, "Folder for the prior files")->required();
  app.add_option("--label-space", a.label_space,
                 "Label space: built-in name, or path prefix of its two files")
      ->capture_default_str();
  app.add_option(
         "--panoptic-encoding", a.inputs.panoptic_encoding,
         "Encoding of panoptic maps: coco (ids of DIR.json), two-channel (red category, green "
         "instance), class-map (8-bit categories), vkitti (default: by DIR.json and content)")
      ->transform(CLI::CheckedTransformer(panoptic_encodings()));
  const std::map<std::string, FieldEncoding> encodings = {{"kitti", FieldEncoding::kKitti},
                                                          {"vkitti", FieldEncoding::kVkitti}};
  app.add_option("--disparity-encoding", a.inputs.disparity_encoding,
                 "PNG encoding: 'kitti' 256 * disparity (default, except for files with names of "
                 "Virtual KITTI 2), 'vkitti' depth in cm")
      ->transform(CLI::CheckedTransformer(encodings));
  app.add_option("--flow-encoding", a.inputs.flow_encoding,
                 "Encoding of flow PNGs: kitti (default, with the same exception), vkitti")
      ->transform(CLI::CheckedTransformer(encodings));
  app.add_option("--config", a.config, "Settings (YAML); see configs/priors_default.yaml");
  one_at_a_time(app.add_option("--set", a.set, "KEY=VALUE, overrides one setting; repeatable"));
  app.add_option("--jobs", a.settings.jobs, "Threads")->check(CLI::Range(1, 256));
  app.add_option("--pair", a.pair,
                 "Cameras of a KITTI odometry sequence: grey (image_0, image_1; default if they "
                 "exist) or colour (image_2, image_3); use the pair that is tracked");
  app.add_option("--start", a.start, "First frame, from 0")->check(whole_number(0));
  app.add_option("--frames", a.frames, "Number of frames (default: all)")->check(whole_number(1));
  app.add_flag("--debug-images", a.settings.debug_images,
               "Write an image of the stages of every frame");
  app.add_flag("--rebuild", a.settings.rebuild, "Build also files that are complete and current");
  app.add_flag("--check", a.check,
               "Build nothing: only check the arguments, the sequence and the label space");
  app.add_flag("--quiet", a.quiet, "No progress");
}

/// Disparity and flow that would not be used.
void check_fields(const BuildInputs& inputs) {
  if (inputs.disparity == "sgbm" && !inputs.disparity_right.empty()) {
    throw InputError("--disparity sgbm estimates both disparities: --disparity-right has no use");
  }
  if (!inputs.flow[1].empty() && inputs.panoptic[1].empty()) {
    throw InputError("--flow-right needs --panoptic-right");
  }
  const char* const sides[] = {"left", "right"};
  for (std::size_t c = 0; c < 2; ++c) {
    if (inputs.flow_back[c].empty()) continue;
    const std::string flow = std::string("--flow-") + sides[c];
    const std::string back = std::string("--flow-back-") + sides[c];
    if (inputs.flow[c].empty()) throw InputError(back + " needs " + flow);
    if (inputs.flow[c] == "dis") {
      throw InputError(flow + " dis estimates both flows: " + back + " has no use");
    }
  }
}

void prepare(Arguments& a) {
  for (std::size_t c = 0; c < 2; ++c) {
    if (!a.panoptic[c].empty() && !a.semantic[c].empty()) {
      throw InputError("give panoptic or semantic maps of a camera, not both");
    }
    a.inputs.panoptic[c] = a.panoptic[c].empty() ? a.semantic[c] : a.panoptic[c];
  }
  if (!a.semantic[0].empty()) a.inputs.panoptic_encoding = PanopticEncoding::kClassMap;
  if (a.inputs.panoptic[0].empty()) {
    throw InputError("--panoptic-left or --semantic-left is needed");
  }
  check_fields(a.inputs);
  for (const std::string& source : a.flow) {
    if (source == "keypoints") {
      a.inputs.keypoints = true;
      continue;
    }
    for (std::string& flow : a.inputs.flow) {
      if (flow.empty()) flow = source;
    }
  }
  if (!a.config.empty()) load_options(a.config, a.settings.options);
  for (const std::string& assignment : a.set) assign_option(a.settings.options, assignment);
}

/// A line that is rewritten on a terminal; every tenth of the work otherwise.
void report(const std::string& stage, std::size_t done, std::size_t total) {
  static const bool terminal = ::isatty(STDERR_FILENO) != 0;
  if (terminal) {
    std::fprintf(stderr, "\r%-16s %zu/%zu%s", stage.c_str(), done, total,
                 done == total ? "\n" : "");
  } else if (done == total || done * 10 / total != (done - 1) * 10 / total) {
    std::fprintf(stderr, "%s %zu/%zu\n", stage.c_str(), done, total);
  }
}

void print(const BuildSummary& s) {
  std::printf("frames            %zu (%zu built, %zu kept)\n", s.frames, s.built, s.kept);
  std::printf("tracks            %lld left, %lld right\n", static_cast<long long>(s.tracks[0]),
              static_cast<long long>(s.tracks[1]));
  std::printf("thing segments    %zu, %zu moving (%zu by the radial test alone)\n",
              s.thing_segments, s.dynamic_segments, s.radial_only_segments);
  std::printf("pixels            %.1f %% labelled, %.2f %% flagged\n", 100 * s.labelled_pixels,
              100 * s.flagged_pixels);
  std::printf("without motion    %zu frames\n", s.frames_without_motion);
  std::printf(
      "file size         %.1f KB mean\n",
      s.frames == 0 ? 0.0 : static_cast<double>(s.bytes) / 1024.0 / static_cast<double>(s.frames));
  if (s.built == 0) return;
  const double n = static_cast<double>(s.built);
  const FusionTimes& f = s.times.fusion;
  std::printf(
      "fusion            %.2f ms/frame: association %.2f, depth %.2f, fit %.2f, "
      "residual %.2f, drift %.2f, statistics %.2f, export %.2f, encoding %.2f\n",
      s.times.total() / n, s.times.association / n, s.times.depth / n, f.fit / n, f.residual / n,
      f.drift / n, f.statistics / n, f.decide_export / n, s.times.encoding / n);
  std::printf("estimates         disparity %.0f, flow %.0f, keypoints %.0f ms/frame\n",
              s.times.stereo / n, s.times.flow / n, s.times.keypoints / n);
}

int run(int argc, char** argv) {
  keep_freed_memory();
  CLI::App app(
      "Builds prior files (one per frame, both cameras) from panoptic maps, disparity and flow.");
  Arguments a;
  declare(app, a);
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  prepare(a);
  BuildSequence sequence = open_build_sequence(a.sequence, a.pair);
  select_frames(sequence, a.start, a.frames);
  const kys::LabelSpace labels = kys::load_label_space(a.label_space);
  if (a.check) {
    check_build(sequence, a.inputs, a.settings);
    return 0;
  }
  for (std::size_t c = 0; c < 2; ++c) {
    for (const std::filesystem::path& input :
         {std::filesystem::path(a.inputs.panoptic[c]), std::filesystem::path(a.inputs.flow[c]),
          std::filesystem::path(a.inputs.flow_back[c])}) {
      if (!input.empty()) check_made_of(input, sequence.images[c]);
    }
  }
  const std::string disparity[] = {a.inputs.disparity, a.inputs.disparity_right};
  for (std::size_t c = 0; c < 2; ++c) {
    if (!disparity[c].empty()) check_made_of(disparity[c], sequence.images[c]);
  }
  if (!a.quiet) a.settings.progress = report;
  print(build_sequence_priors(sequence, labels, a.inputs, a.settings));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("build_priors", [&] { return run(argc, argv); });
}
