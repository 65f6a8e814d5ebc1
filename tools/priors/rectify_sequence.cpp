// SPDX-License-Identifier: BSD-3-Clause
// rectify_sequence: the rectified images of a sequence as PNG, as input of perception networks.
// Priors are in the geometry of the rectified images.
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <utility>

#include "common/command_line.h"
#include "open_sequence.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

constexpr const char* kSource = "rectified_from.txt";
constexpr std::size_t kMostPathBytes = 16384;

/// A run that was ended goes on in its folder; images of two sequences do not go into one.
void check_source(const fs::path& output, const std::string& source) {
  constexpr std::size_t kMostBytes = 65536;
  if (!path_exists(output) || (is_folder(output) && list_folder(output).empty())) return;
  const fs::path record = output / kSource;
  if (path_exists(record) && read_text(record, kMostBytes) == source) return;
  throw InputError("--output " + output.string() + ": is not empty and not made of this sequence");
}

/// Images that are there were made of the images and with the calibration of today: the first pair
/// tells, since every calibration changes all of them.
void check_first_pair(const BuildSequence& sequence, const fs::path& left, const fs::path& right) {
  const std::string file = sequence.names.front() + ".png";
  if (!path_exists(left / file) && !path_exists(right / file)) return;
  const auto pair = sequence.read(0);
  const auto same = [](const fs::path& path, const GrayImage& image) {
    if (!path_exists(path)) return true;
    const GrayImage there = read_gray(path);
    return there.width() == image.width() && there.height() == image.height() &&
           std::equal(there.data(), there.data() + there.size(), image.data());
  };
  for (const auto& [path, image] :
       {std::pair(left / file, &pair.first), {right / file, &pair.second}}) {
    if (same(path, *image)) continue;
    throw InputError(path.string() +
                     ": was made with another calibration or of another image; remove the folder, "
                     "or give another --output");
  }
}

/// The sequence as a pair without the error that the file tells of.
void correct(BuildSequence& sequence, const std::string& calibration) {
  const RigEstimate rig = read_rig_correction(calibration, sequence.camera);
  const auto rectifier =
      std::make_shared<StereoRectifier>(sequence.camera, rig.correction, calibration);
  sequence.camera = rectifier->camera();
  sequence.read = [rectifier, read = sequence.read](std::size_t t) {
    const auto pair = read(t);
    return std::pair(rectifier->rectify_left(pair.first), rectifier->rectify_right(pair.second));
  };
}

std::string times_of(const BuildSequence& sequence) {
  std::string text;
  for (const double time : sequence.timestamps) {
    std::array<char, 32> line;
    std::snprintf(line.data(), line.size(), "%.9f\n", time);
    text += line.data();
  }
  return text;
}

int run(int argc, char** argv) {
  CLI::App app(
      "Writes the rectified images of a sequence in KITTI layout (image_0, image_1, calib.txt, "
      "times.txt), "
      "as input of perception networks.");
  std::string input, output, calibration;
  app.add_option("sequence", input, "Sequence folder")->required();
  app.add_option("--output", output, "Folder to write to")->required();
  app.add_option("--calibration", calibration,
                 "File with a correction of the sequence's calibration (calibrate_rig): the images "
                 "are those of a perfect pair");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  BuildSequence sequence = open_build_sequence(input);
  if (!calibration.empty()) correct(sequence, calibration);
  const fs::path left = fs::path(output) / "image_0", right = fs::path(output) / "image_1";
  for (const fs::path& place : {left, right}) {
    for (const char* name : {"image_0", "image_1", "image_2", "image_3", "mav0"}) {
      if (is_same_path(place, fs::path(input) / name) || is_same_path(output, input)) {
        throw InputError("--output " + output + ": is the sequence itself");
      }
    }
  }
  std::string source = printable(fs::canonical(input).string(), kMostPathBytes) + "\n";
  if (!calibration.empty()) {
    source +=
        "corrected by " + printable(fs::canonical(calibration).string(), kMostPathBytes) + "\n";
  }
  check_source(output, source);
  check_first_pair(sequence, left, right);
  make_output_folder(output);
  write_file_atomic(fs::path(output) / kSource, source);
  make_output_folder(left);
  make_output_folder(right);
  const StereoCamera& k = sequence.camera;
  char calib[512];
  std::snprintf(calib, sizeof calib,
                "P0: %.12g 0 %.12g 0 0 %.12g %.12g 0 0 0 1 0\n"
                "P1: %.12g 0 %.12g %.12g 0 %.12g %.12g 0 0 0 1 0\n",
                k.fx, k.cx, k.fy, k.cy, k.fx, k.cx, -k.bf(), k.fy, k.cy);
  write_file_atomic(fs::path(output) / "calib.txt", calib);
  write_file_atomic(fs::path(output) / "times.txt", times_of(sequence));
  for (std::size_t t = 0; t < sequence.names.size(); ++t) {
    const std::string file = sequence.names[t] + ".png";
    if (!path_exists(right / file)) {
      const auto pair = sequence.read(t);
      write_png(left / file, pair.first);
      write_png(right / file, pair.second);
    }
    if ((t + 1) % 50 == 0 || t + 1 == sequence.names.size()) {
      std::fprintf(stderr, "rectified %zu/%zu\n", t + 1, sequence.names.size());
    }
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("rectify_sequence", [&] { return run(argc, argv); });
}
