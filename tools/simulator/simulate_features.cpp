#include <kys_slam/error.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>

#include "common/command_line.h"
#include "feature_world.h"

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

int run(int argc, char** argv) {
  using namespace kys_slam;
  using namespace kys_slam::simulator;
  FeatureOptions o;
  std::string trajectory;
  std::string output;
  bool quiet = false;
  CLI::App app(
      "Simulates stereo features, without images, along a trajectory: landmarks strewn along it,\n"
      "seen again when it comes back, with noise and outliers. Long sequences in minutes.\n\n"
      "Example: simulate_features ground_truth/00.txt --output kitti00.features");
  app.add_option("trajectory", trajectory, "KITTI (12 columns) or TUM (8 columns)")->required();
  app.add_option("--output", output, "feature file to write")->required();
  app.add_option("--camera", o.camera,
                 "kitti, euroc (a TUM file then gives the body frame) or auto (by file format)")
      ->capture_default_str();
  app.add_option("--seed", o.seed, "of landmarks and noise")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--start", o.start, "first pose used")->capture_default_str();
  app.add_option("--frames", o.frames, "poses used (default: all)");
  app.add_option("--every", o.every, "of the file's poses the first, and then each so many")
      ->capture_default_str();
  app.add_option("--features", o.features, "per image (default: kitti 2000, euroc 1200)");
  app.add_option("--pixel-noise", o.pixel_noise, "sigma at octave 0, px")->capture_default_str();
  app.add_option("--wander", o.wander, "how far a corner moves with the view of it, octave 0, px")
      ->capture_default_str();
  app.add_option("--lens", o.lens, "what calibration leaves of each lens' distortion, px")
      ->capture_default_str();
  app.add_option("--bit-noise", o.bit_noise, "probability that a descriptor bit flips")
      ->capture_default_str();
  app.add_option("--outliers", o.outliers, "share of features that are not seen again")
      ->capture_default_str();
  app.add_option("--dropout", o.dropout, "share of visible landmarks that a camera does not detect")
      ->capture_default_str();
  app.add_option("--repeats", o.repeats, "share of landmarks that look like others")
      ->capture_default_str();
  app.add_option("--rate", o.rate, "Hz, for files without time stamps")->capture_default_str();
  app.add_option("--near", o.near, "least depth of new landmarks, m (default: by camera)");
  app.add_option("--far", o.far, "greatest depth of new landmarks, m (default: by camera)");
  app.add_flag("--quiet", quiet, "no progress");
  if (const auto status = kys_slam::parse_command_line(app, argc, argv)) return *status;
  if (app.count("--frames") > 0 && o.frames < 1) {
    throw InputError("--frames " + std::to_string(o.frames) + ": must be at least 1");
  }
  if (app.count("--features") > 0 && o.features < 50) {
    throw InputError("--features: must lie between 50 and 20000");
  }
  const FeaturePath path = read_feature_path(trajectory, o);
  Progress progress(quiet);
  const FeatureWorld world(path, o, [&](double share) { progress("landmarks", share); });
  FeatureSequenceWriter writer(output, world.info());
  for (std::size_t i = 0; i < path.poses.size(); ++i) {
    writer.write(world.frame(i));
    progress("frames", static_cast<double>(i + 1) / static_cast<double>(path.poses.size()));
  }
  writer.finish();
  std::printf("%s: %zu frames, %zu landmarks\n", output.c_str(), path.poses.size(),
              world.landmark_count());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("simulate_features", [&] { return run(argc, argv); });
}
