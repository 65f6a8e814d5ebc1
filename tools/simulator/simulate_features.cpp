// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <future>
#include <list>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/command_line.h"
#include "simulator/common/coco_classes.h"
#include "simulator/features/feature_world.h"
#include "simulator/perception/perception.h"
#include "simulator/traffic/replayed_objects.h"
#include "simulator/traffic/traffic.h"

namespace {

// A line every two seconds.
class Progress {
 public:
  explicit Progress(bool quiet) : quiet_(quiet) {}
  void operator()(const char* what, double share) {
    const double now =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    if (quiet_ || now < last_ + 2) return;
    last_ = now;
    const bool terminal = isatty(2) != 0;
    std::fprintf(stderr, "%ssimulate_features: %s %.0f %%%s", terminal ? "\r" : "", what,
                 100 * share, terminal ? "   " : "\n");
  }

 private:
  bool quiet_;
  double last_ = 0;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// A feature file that is being written, with the perception that its priors come from.
struct Output {
  Output(const std::string& path, const kys_slam::FeatureFileInfo& info,
         const kys_slam::FeatureTruth& truth)
      : file(path), writer(path, info, truth) {}

  std::string file;
  kys_slam::FeatureSequenceWriter writer;
  std::optional<kys_slam::simulator::Perception> perception;
};

std::list<Output> open_outputs(const kys_slam::simulator::FeatureWorld& world,
                               const kys_slam::simulator::FeatureOptions& o,
                               const std::vector<std::string>& levels,
                               const std::vector<std::string>& files) {
  using namespace kys_slam;
  using namespace kys_slam::simulator;
  FeatureFileInfo info = world.info();
  if (o.labelled) info.label_space = kFeatureLabelSpace;
  const FeatureTruth truth = info.version == 1 ? FeatureTruth{} : world.truth();
  std::list<Output> outputs;
  for (std::size_t i = 0; i < files.size(); ++i) {
    Output& output = outputs.emplace_back(files[i], info, truth);
    if (o.labelled) output.perception.emplace(world, perception_level(levels[i]), o.seed);
  }
  return outputs;
}

/// The features are the same in all files; their priors are those of a level of perception each.
void write_frames(const kys_slam::simulator::FeatureWorld& world,
                  const kys_slam::simulator::FeatureOptions& o,
                  const std::vector<std::string>& levels, const std::vector<std::string>& files,
                  Progress& progress) {
  using namespace kys_slam;
  using namespace kys_slam::simulator;
  const std::size_t frames = world.path().poses.size();
  std::list<Output> outputs = open_outputs(world, o, levels, files);
  double mover_share = 0;
  // A frame depends on the world alone: some are made ahead, each by its own thread.
  const std::size_t threads = std::max(1U, std::thread::hardware_concurrency());
  std::deque<std::future<FeatureFrame>> ahead;
  for (std::size_t i = 0; i < frames; ++i) {
    while (ahead.size() < threads && i + ahead.size() < frames) {
      const std::size_t next = i + ahead.size();
      ahead.push_back(std::async(std::launch::async, [&world, next] { return world.frame(next); }));
    }
    FeatureFrame frame = ahead.front().get();
    ahead.pop_front();
    mover_share += frame.mover_share;
    for (Output& output : outputs) {
      if (output.perception) output.perception->add_priors(i, frame);
      output.writer.write(frame);
    }
    progress("frames", static_cast<double>(i + 1) / static_cast<double>(frames));
  }
  for (Output& output : outputs) {
    output.writer.finish();
    std::printf("%s: %zu frames, %zu landmarks", printable(output.file).c_str(), frames,
                world.landmark_count());
    if (o.traffic != Traffic::kNone || !o.objects.empty()) {
      std::printf(", moving objects cover %.1f %% of the image",
                  100 * mover_share / static_cast<double>(frames));
    }
    std::printf("\n");
    if (!output.perception) continue;
    const Perception::Score& s = output.perception->score();
    std::printf(
        "segments of things flagged as moving: %lld of %lld that move, %lld of %lld that do "
        "not\n",
        static_cast<long long>(s.moving_flagged), static_cast<long long>(s.moving),
        static_cast<long long>(s.still_flagged), static_cast<long long>(s.still));
  }
}

struct Arguments {
  kys_slam::simulator::FeatureOptions options;
  std::string trajectory;
  std::vector<std::string> outputs;
  std::string traffic = "none";
  std::vector<std::string> perception{"none"};
  std::string objects;
  std::string rig_error;
  bool quiet = false;
};

void declare(CLI::App& app, Arguments& a) {
  kys_slam::simulator::FeatureOptions& o = a.options;
  app.add_option("trajectory", a.trajectory, "KITTI (12 columns) or TUM (8 columns)")->required();
  app.add_option("--output", a.outputs, "feature file to write; once for each level of perception")
      ->required()
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--camera", o.camera,
                 "kitti, euroc (a TUM file then gives the body frame) or auto (by file format)")
      ->capture_default_str();
  app.add_option("--seed", o.seed, "seed of landmarks and noise")
      ->check(kys_slam::whole_number(0))
      ->capture_default_str();
  app.add_option("--start", o.start, "first pose used")->capture_default_str();
  app.add_option("--frames", o.frames, "poses used (default: all)");
  app.add_option("--every", o.every, "every N-th pose of the file, from the first")
      ->capture_default_str();
  app.add_option("--features", o.features, "per image (default: kitti 2000, euroc 1200)");
  app.add_option("--pixel-noise", o.pixel_noise, "sigma at octave 0, px")->capture_default_str();
  app.add_option("--wander", o.wander, "viewpoint-dependent shift of a corner, octave 0, px")
      ->capture_default_str();
  app.add_option("--lens", o.lens, "residual lens distortion after calibration, px")
      ->capture_default_str();
  app.add_option("--bit-noise", o.bit_noise, "probability that a descriptor bit flips")
      ->capture_default_str();
  app.add_option("--outliers", o.outliers, "share of features that are never observed again")
      ->capture_default_str();
  app.add_option("--dropout", o.dropout, "share of visible landmarks that a camera does not detect")
      ->capture_default_str();
  app.add_option("--repeats", o.repeats, "share of landmarks that share a descriptor with others")
      ->capture_default_str();
  app.add_option("--rate", o.rate, "Hz, for files without time stamps")->capture_default_str();
  app.add_option("--frame-rate", o.frame_rate,
                 "Hz: every N-th pose, so that the time between two is nearest to 1/HZ (default: "
                 "all poses)");
  app.add_option("--near", o.near, "least depth of new landmarks, m (default: by camera)");
  app.add_option("--far", o.far, "greatest depth of new landmarks, m (default: by camera)");
  app.add_option("--traffic", a.traffic, "moving objects with occlusion: none, light, city, jam")
      ->capture_default_str();
  app.add_option("--objects", a.objects,
                 "objects.csv of a rendered world: use its objects instead of traffic; the "
                 "trajectory must be that of the world");
  app.add_option("--rig-error", a.rig_error,
                 "the true cameras differ from the given ones: a YAML file, kitti (as measured "
                 "there) or random:N (drawn from seed N); tools/simulator/README.md describes it");
  app.add_option("--width", o.width,
                 "px, width of KITTI images; scales the camera (default: 1241)");
  app.add_option("--perception", a.perception,
                 "priors for every feature, with the errors of a level of perception: none, exact, "
                 "estimated, poor. Several, separated by commas, take the features once: "
                 "--perception exact,poor --output A --output B")
      ->delimiter(',')
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)
      ->default_str("none");
  app.add_flag("--quiet", a.quiet, "no progress");
}

/// Poses of a whole trajectory, of which --frames may take a part.
std::size_t poses_in(const std::string& trajectory, kys_slam::simulator::FeatureOptions options) {
  options.frames = kys_slam::simulator::FeatureOptions().frames;
  return kys_slam::simulator::read_feature_path(trajectory, options).poses.size();
}

/// \throws InputError when a level is unknown, or has no file of its own.
void check_levels(const std::vector<std::string>& levels, const std::vector<std::string>& outputs) {
  if (levels.size() != outputs.size()) {
    const std::string wanted = std::to_string(levels.size());
    throw kys_slam::InputError("--perception: levels: " + wanted + ", so --output must be there " +
                               wanted + " times, not " + std::to_string(outputs.size()));
  }
  if (levels == std::vector<std::string>{"none"}) return;
  for (const std::string& level : levels) {
    if (level == "none") throw kys_slam::InputError("--perception: none cannot be one of several");
    kys_slam::simulator::perception_level(level);  // refuses what it does not know
  }
}

/// \throws InputError when an output is an input or another output, or cannot be written.
void check_output(const Arguments& a, std::size_t i) {
  const std::string& output = a.outputs[i];
  for (const std::string& input : {a.trajectory, a.objects}) {
    if (kys_slam::is_same_path(output, input)) {
      throw kys_slam::InputError("--output " + output + ": is the input");
    }
  }
  for (std::size_t j = 0; j < i; ++j) {
    if (std::filesystem::weakly_canonical(output) ==
        std::filesystem::weakly_canonical(a.outputs[j])) {
      throw kys_slam::InputError("--output " + output + ": is there twice");
    }
  }
  kys_slam::check_writable(output);
}

int run(int argc, char** argv) {
  using namespace kys_slam;
  using namespace kys_slam::simulator;
  Arguments a;
  CLI::App app(
      "Simulates stereo features, without images, along a trajectory: landmarks on both sides of "
      "it,\n"
      "seen again when it comes back, with noise and outliers. Long sequences in minutes.\n\n"
      "Example: simulate_features ground_truth/00.txt --output kitti00.features");
  declare(app, a);
  FeatureOptions& o = a.options;
  if (const auto status = kys_slam::parse_command_line(app, argc, argv)) return *status;
  if (app.count("--frames") > 0 && o.frames < 1) {
    throw InputError("--frames " + std::to_string(o.frames) + ": must be at least 1");
  }
  if (app.count("--features") > 0 && o.features < 50) {
    throw InputError("--features: must lie between 50 and 20000");
  }
  o.traffic = parse_traffic(a.traffic);
  if (!a.objects.empty() && (o.traffic != Traffic::kNone || o.start != 0 || o.every != 1 ||
                             app.count("--frame-rate") > 0)) {
    throw InputError("--objects: not with --traffic, --start, --every or --frame-rate");
  }
  check_levels(a.perception, a.outputs);
  o.labelled = a.perception.front() != "none";
  for (std::size_t i = 0; i < a.outputs.size(); ++i) check_output(a, i);
  const FeaturePath path = read_feature_path(a.trajectory, o);
  if (app.count("--rig-error") > 0) o.rig_error = make_rig_error(a.rig_error, path.camera);
  if (!a.objects.empty()) o.objects = read_objects(a.objects, poses_in(a.trajectory, o));
  Progress progress(a.quiet);
  const FeatureWorld world(path, o, [&](double share) { progress("landmarks", share); });
  write_frames(world, o, a.perception, a.outputs, progress);
  for (const std::string& output : a.outputs) {
    if (o.rig_error) write_file_atomic(output + ".rig_error.yaml", to_yaml(*o.rig_error));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("simulate_features", [&] { return run(argc, argv); });
}
