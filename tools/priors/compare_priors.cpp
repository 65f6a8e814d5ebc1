// SPDX-License-Identifier: BSD-3-Clause
// compare_priors: at how many ORB keypoints two sets of priors differ.
#include <kys_slam/error.h>
#include <kys_slam/feature_extractor.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>

#include <array>
#include <cstdio>
#include <memory>

#include "common/command_line.h"
#include "exposure.h"
#include "open_sequence.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

PriorFile open_checked(const fs::path& path, const StereoCamera& camera) {
  ExpectedPriors expected;
  expected.width = camera.width;
  expected.height = camera.height;
  return PriorFile::open(path, expected);
}

std::string row_of(const std::string& name, const char* camera, const Exposure& e) {
  std::string row = csv_field(name) + "," + camera;
  for (const std::size_t count :
       {e.keypoints, e.label, e.instance, e.dynamic, e.stereo_gate, e.temporal_gate, e.any}) {
    row += "," + std::to_string(count);
  }
  return row + "\n";
}

void print(const char* what, std::size_t count, std::size_t total) {
  std::printf("%-34s %7.3f %%\n", what,
              total == 0 ? 0.0 : 100.0 * static_cast<double>(count) / static_cast<double>(total));
}

void run(const fs::path& reference, const fs::path& other, const fs::path& folder,
         const Settings& settings, const std::string& csv) {
  const BuildSequence sequence = open_build_sequence(folder);
  const std::unique_ptr<FeatureExtractor> extractor = make_orb_extractor(settings);
  std::array<FeatureSet, 2> both;
  std::vector<kys::Prior> a, b;
  Exposure total;
  std::string table =
      "frame,camera,keypoints,label,instance,dynamic,stereo_gate,temporal_gate,any\n";
  std::size_t used = 0;
  for (std::size_t t = 0; t < sequence.names.size(); ++t) {
    const fs::path name = sequence.names[t] + ".kysp";
    if (!path_exists(reference / name) || !path_exists(other / name)) continue;
    ++used;
    const PriorFile first = open_checked(reference / name, sequence.camera);
    const PriorFile second = open_checked(other / name, sequence.camera);
    if (first.label_space() != second.label_space()) {
      throw InputError((other / name).string() + ": label space " + second.label_space() +
                       " instead of " + first.label_space());
    }
    const auto images = sequence.read(t);
    extractor->extract(images.first, images.second, both[0], both[1]);
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const bool left = side == CameraSide::kLeft;
      const FeatureSet& features = both[left ? 0 : 1];
      a.resize(features.size());
      b.resize(features.size());
      first.lookup(side, features.keypoints, a);
      second.lookup(side, features.keypoints, b);
      Exposure frame;
      frame.add(a, b);
      table += row_of(sequence.names[t], left ? "left" : "right", frame);
      total += frame;
    }
    if (used % 50 == 0) std::fprintf(stderr, "frame %zu/%zu\n", t + 1, sequence.names.size());
  }
  if (used == 0) {
    throw InputError(other.string() + ": has no prior file that is in " + reference.string() +
                     " and belongs to a frame of " + folder.string());
  }
  std::printf("%zu frames, %zu keypoints of both cameras\n", used, total.keypoints);
  print("another class", total.label, total.keypoints);
  print("another instance or class", total.instance, total.keypoints);
  print("flagged as moving in one only", total.dynamic, total.keypoints);
  print("on the other side of mu = 8", total.stereo_gate, total.keypoints);
  print("on the other side of mu = 20", total.temporal_gate, total.keypoints);
  print("wrong: class, flag or gate", total.any, total.keypoints);
  if (!csv.empty()) write_file_atomic(csv, table);
}

int run(int argc, char** argv) {
  CLI::App app(
      "Keypoint exposure: the share of ORB keypoints of a sequence with different priors in two "
      "folders, e.g. of exact and perturbed perception.");
  std::string reference, other, sequence, csv;
  int features = 2000;
  app.add_option("reference", reference, "Folder of prior files")->required();
  app.add_option("other", other, "Folder of prior files")->required();
  app.add_option("sequence", sequence, "Sequence folder, for the keypoints")->required();
  app.add_option("--features", features, "Keypoints wanted per image")->capture_default_str();
  app.add_option("--csv", csv, "Table of counts per frame and camera to write");
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  Settings settings;
  settings.set("orb.features", std::to_string(features));
  settings.check();
  for (const std::string& folder : {reference, other}) {
    if (!is_folder(folder)) throw InputError(folder + ": is not a folder");
  }
  if (!csv.empty()) check_writable(csv);
  run(reference, other, sequence, settings, csv);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("compare_priors", [&] { return run(argc, argv); });
}
