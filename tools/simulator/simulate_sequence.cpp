// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/util/parse_number.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <limits>
#include <vector>

#include "common/command_line.h"
#include "simulator/images/sequence_writer.h"
#include "simulator/worlds/world.h"

namespace {

std::atomic<bool> interrupted{false};

// WxH
void parse_size(const std::string& text, kys_slam::simulator::WorldOptions& options) {
  const std::size_t middle = std::min(text.find('x'), text.size());
  const auto width = kys_slam::parse_int(std::string_view(text).substr(0, middle));
  const auto height =
      kys_slam::parse_int(std::string_view(text).substr(std::min(middle + 1, text.size())));
  if (!width || !height) {
    throw kys_slam::InputError("--size " + text + ": must be WIDTHxHEIGHT, such as 1241x376");
  }
  if (*width <= 0 || *height <= 0) {
    throw kys_slam::InputError("--size " + text + ": must be positive");
  }
  constexpr std::int64_t kLargest = std::numeric_limits<int>::max();
  if (*width > kLargest || *height > kLargest) {
    throw kys_slam::InputError("--size " + text + ": is too large");
  }
  options.width = static_cast<int>(*width);
  options.height = static_cast<int>(*height);
}

// " --blur L,R --exposure-difference D", without those that are the defaults.
std::string sensor_options(const kys_slam::simulator::WorldOptions& options) {
  const kys_slam::simulator::WorldOptions defaults;
  char text[128] = "";
  std::string out;
  if (options.blur != defaults.blur) {
    std::snprintf(text, sizeof text, " --blur %.9g,%.9g", options.blur[0], options.blur[1]);
    out += text;
  }
  if (options.exposure_difference != defaults.exposure_difference) {
    std::snprintf(text, sizeof text, " --exposure-difference %.9g", options.exposure_difference);
    out += text;
  }
  return out;
}

// What makes these files again. --frames is there if it was given: plans of experiments compare the
// options. --jobs and --quiet are left out: they change nothing in the files.
std::string command_of(const kys_slam::simulator::World& world,
                       const kys_slam::simulator::WorldOptions& world_options,
                       const kys_slam::simulator::WriteOptions& write_options,
                       const std::string& rig_error, bool images_only) {
  std::string command = "simulate_sequence " + world_options.name + " --output " +
                        write_options.output.string() + " --seed " +
                        std::to_string(world_options.seed);
  if (world_options.frames > 0) command += " --frames " + std::to_string(world_options.frames);
  command += " --size " + std::to_string(world.rig.left.width()) + "x" +
             std::to_string(world.rig.left.height());
  if (!rig_error.empty()) command += " --rig-error " + rig_error;
  command += sensor_options(world_options);
  if (images_only) command += " --images-only";
  if (write_options.surface_points > 0) {
    command += " --surface-points " + std::to_string(write_options.surface_points);
  }
  if (write_options.drop_camera >= 0) {
    char text[64];
    std::snprintf(text, sizeof text, " --drop-camera %d --drop-share %g", write_options.drop_camera,
                  write_options.drop_share);
    command += text;
  }
  return command;
}

/// Long: one option after the other.
int run(int argc, char** argv) {
  using namespace kys_slam::simulator;
  WorldOptions world_options;
  WriteOptions write_options;
  std::string size, rig_error;
  std::vector<double> blur;
  bool images_only = false;
  CLI::App app(
      "Renders a simulated stereo sequence with exact ground truth.\n\n"
      "Worlds: street (a drive through a busy street, KITTI layout, 200 frames), traffic (cars\n"
      "ahead, beside and oncoming cover half of the view), jam (stopped vehicles cover more than\n"
      "half of the view, some start), block (once around a block, nearly static, closes a loop),\n"
      "hall (a drone in a hall, EuRoC layout). The same options give the same bytes, whatever\n"
      "--jobs is.\n\n"
      "Example: simulate_sequence street --output street --seed 3");
  app.add_option("world", world_options.name, "street, traffic, jam, block or hall")->required();
  app.add_option("--output", write_options.output, "output folder; must not exist or be empty")
      ->required();
  app.add_option("--seed", world_options.seed, "seed of houses, cars, textures, noise")
      ->check(kys_slam::whole_number(0))
      ->capture_default_str();
  auto* frames =
      app.add_option("--frames", world_options.frames, "number of frames (default: the world's)");
  app.add_option("--size", size, "WxH in px (default: the data set's; the calibration is scaled)");
  app.add_option("--rig-error", rig_error,
                 "the true cameras differ from the calibration: a YAML file, kitti (as measured "
                 "there) or random:N (drawn from seed N); tools/simulator/README.md describes it");
  app.add_option("--blur", blur,
                 "px, sigma of the image of a point: one value, or one of the left and one of the "
                 "right camera: 0,1.5 (default: 0)")
      ->delimiter(',')
      ->expected(1, 2);
  app.add_option("--exposure-difference", world_options.exposure_difference,
                 "share by which right images are darker than left ones, negative: brighter")
      ->capture_default_str();
  // What the struct takes for "all" or "none" is said by leaving these out.
  app.add_option("--jobs", write_options.jobs, "threads (default: one per processor)")
      ->check(CLI::Range(1, 1024));
  app.add_option("--surface-points", write_options.surface_points,
                 "points of the static surfaces in view, to surface.ply (kys-slam map evaluate)")
      ->check(kys_slam::whole_number(1, 20000000));
  app.add_flag("--images-only", images_only, "no disparity, flow, or panoptic segments");
  auto* camera = app.add_option("--drop-camera", write_options.drop_camera,
                                "hall: camera (0 or 1) whose frames are dropped")
                     ->check(CLI::Range(0, 1));
  auto* share = app.add_option("--drop-share", write_options.drop_share,
                               "hall: share of frames dropped from --drop-camera (default 0.1)")
                    ->needs(camera);
  app.add_flag("--quiet", write_options.quiet, "no progress");
  if (const auto status = kys_slam::parse_command_line(app, argc, argv)) return *status;
  if (!size.empty()) parse_size(size, world_options);
  if (frames->count() > 0 && world_options.frames < 1) {
    throw kys_slam::InputError("--frames " + std::to_string(world_options.frames) +
                               ": must be at least 1");
  }
  if (write_options.drop_camera >= 0 && share->count() == 0) write_options.drop_share = 0.1;
  if (write_options.drop_camera >= 0 && world_options.name != "hall") {
    throw kys_slam::InputError("--drop-camera: only the world 'hall' can lose frames");
  }
  if (!blur.empty()) world_options.blur = {blur.front(), blur.back()};
  World world = make_world(world_options);
  if (app.count("--rig-error") > 0) {
    apply_rig_error(world, make_rig_error(rig_error, world.rectified));
  }
  write_options.command = command_of(world, world_options, write_options, rig_error, images_only);
  write_options.truth = !images_only;
  write_options.stop = &interrupted;
  std::signal(SIGINT, [](int) { interrupted = true; });
  std::signal(SIGTERM, [](int) { interrupted = true; });
  const SequenceFigures figures = write_sequence(world, write_options);
  std::printf("%s: %zu frames of world %s\n",
              kys_slam::printable(write_options.output.string()).c_str(), world.times.size(),
              world.name.c_str());
  if (figures.moving >= 0) {
    std::printf(
        "moving objects cover %.1f %% of the left images, static objects that can move %.1f %%\n",
        100 * figures.moving, 100 * figures.standing);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("simulate_sequence", [&] { return run(argc, argv); });
}
