// SPDX-License-Identifier: BSD-3-Clause
// perturb_priors: perception with errors put in, to build priors from (the paper's robustness
// study). Segmentation: nested relabelling of thing segments. Flow: noise scaled by the flow's
// length, or spatially correlated failure. A check of the disturbed flow against a clean backward
// flow would take the errors out again: build with flow_check.enabled=false. Decisions: prior files
// whose motion detector is wrong, late or absent.
#include <kys_slam/error.h>
#include <kys_slam/util/paths.h>

#include <cstdio>

#include "common/command_line.h"
#include "decision_errors.h"
#include "perturbation.h"

namespace {

/// Long: the options of three subcommands, one after the other.
int run(int argc, char** argv) {
  using namespace kys_slam;
  namespace fs = std::filesystem;
  CLI::App app("Adds errors to perception outputs or to prior files.");
  app.require_subcommand(1);
  std::string input, output, error_case, own_space, label_space = "coco_panoptic_133";
  double share = 0.1, relative = 0.06, correlation = 0;
  std::uint64_t seed = 1;
  FieldEncoding encoding = FieldEncoding::kUnspecified;
  const std::map<std::string, FieldEncoding> encodings = {{"kitti", FieldEncoding::kKitti},
                                                          {"vkitti", FieldEncoding::kVkitti}};
  auto* segments = app.add_subcommand("segments", "Relabel thing segments (COCO panoptic folder)");
  auto* flow = app.add_subcommand("flow",
                                  "Noise in proportion to the flow; writes KITTI PNG. Use "
                                  "build_priors with --set flow_check.enabled=false; otherwise the "
                                  "check removes errors that contradict the backward flow");
  auto* decisions = app.add_subcommand("decisions",
                                       "Prior files with errors of the motion detector. Cases:\n"
                                       "  parked         every vehicle is flagged as moving\n"
                                       "  blind          nothing is flagged as moving\n"
                                       "  drop           30 % of the files are missing, in "
                                       "runs of 1 to 8 frames\n"
                                       "  flip           per instance and interval of 10 frames, "
                                       "wrong with probability 0.3\n"
                                       "  late           every file is from the frame before\n"
                                       "  bleed          moving segments are 8 px too large\n"
                                       "  segments-only  motion is not judged");
  for (auto* command : {segments, flow, decisions}) {
    command->add_option("input", input, "Folder")->required();
    command->add_option("--output", output, "Folder to write to")->required();
    command->add_option("--seed", seed, "Seed")->check(whole_number(0))->capture_default_str();
  }
  segments
      ->add_option("--share", share, "Share of thing segments, 0..1; a smaller share is a subset")
      ->check(finite_range(0, 1));
  segments->add_option("--label-space", label_space, "Label space");
  flow->add_option("--relative", relative,
                   "Noise per component, relative to the length of the flow")
      ->check(finite_range(0, 10));
  flow->add_option("--correlation", correlation,
                   "px, correlation length of errors (0: independent pixels, as in the paper)")
      ->check(finite_range(0, 1000));
  flow->add_option("--encoding", encoding, "Of PNGs: kitti, vkitti")
      ->transform(CLI::CheckedTransformer(encodings));
  decisions->add_option("--case", error_case, "Kind of error")
      ->required()
      ->check(CLI::IsMember(decision_error_names()));
  decisions->add_option("--label-space", own_space,
                        "Label space of the files, by name or path (default: the built-in one "
                        "that they name)");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  while (input.size() > 1 && input.back() == '/') input.pop_back();
  while (output.size() > 1 && output.back() == '/') output.pop_back();
  if (!is_folder(input)) throw InputError(input + ": is not a folder");
  if (segments->parsed()) {
    const Relabelling done =
        relabel_segments(input, output, share, seed, kys::load_label_space(label_space));
    std::printf("relabelled %zu of %zu thing segments\n", done.hit, done.things);
  } else if (decisions->parsed()) {
    const DecisionErrorCounts done =
        disturb_decisions(input, output, parse_decision_error(error_case), seed, own_space);
    std::printf("wrote %zu of %zu files; of %zu thing segments %zu were called moving, now %zu\n",
                done.written, done.files, done.things, done.moving_before, done.moving_after);
  } else {
    std::printf("mean error %.2f px\n",
                disturb_flow(input, output, relative, correlation, seed, encoding));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("perturb_priors", [&] { return run(argc, argv); });
}
