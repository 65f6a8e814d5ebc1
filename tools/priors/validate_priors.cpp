// SPDX-License-Identifier: BSD-3-Clause
// validate_priors: is there a sound prior file, made for this sequence, for every frame?
#include <kys/label_space.h>
#include <kys_slam/calibration_hash.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_file.h>
#include <kys_slam/prior_folder.h>
#include <kys_slam/prior_format.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "open_sequence.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

/// Classes of the label spaces that files name, by name; 0: not built in. Such a space is in files
/// whose path only the user knows.
class LabelCounts {
 public:
  std::size_t of(const std::string& name) {
    const auto [at, is_new] = counts_.try_emplace(name, 0);
    if (!is_new) return at->second;
    const std::vector<std::string>& known = kys::builtin_label_spaces();
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      std::fprintf(stderr,
                   "validate_priors: labels of label space %s are not checked: it is not built in "
                   "(--label-space)\n",
                   printable(name).c_str());
    } else {
      at->second = kys::load_label_space(name).size();
    }
    return at->second;
  }

 private:
  std::map<std::string, std::size_t> counts_;
};

/// A file whose labels are in its label space, that of `expected` or the one it names.
PriorFile open_checked(const fs::path& path, const ExpectedPriors& expected, LabelCounts& counts) {
  PriorFile file = PriorFile::open(path, expected);
  if (expected.label_count > 0) return file;
  const std::size_t count = counts.of(file.label_space());
  for (std::size_t c = 0; c < file.camera_count() && count > 0; ++c) {
    for (const PriorSegment& s : file.segments(static_cast<CameraSide>(c))) {
      if (s.label < count) continue;
      throw InputError(path.string() + ": label " + std::to_string(s.label) +
                       " is not in label space " + file.label_space());
    }
  }
  return file;
}

int run(int argc, char** argv) {
  CLI::App app("Checks prior files: count, sizes, checksums, calibration, label space, coverage.");
  std::string folder, sequence_folder, label_space, pair;
  std::int64_t start = 0;
  std::optional<std::int64_t> frames;
  app.add_option("folder", folder, "Folder of prior files")->required();
  app.add_option("--sequence", sequence_folder, "Folder of the sequence")->required();
  app.add_option("--label-space", label_space, "Required label space");
  app.add_option("--pair", pair, "Cameras of a KITTI odometry sequence: grey or colour");
  app.add_option("--start", start, "First frame, from 0")->check(whole_number(0));
  app.add_option("--frames", frames, "Number of frames (default: all)")->check(whole_number(1));
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  if (!is_folder(folder)) throw InputError(folder + ": is not a folder");
  BuildSequence sequence = open_build_sequence(sequence_folder, pair);
  select_frames(sequence, start, frames);
  ExpectedPriors expected;
  expected.width = sequence.camera.width;
  expected.height = sequence.camera.height;
  expected.calibration_hash = calibration_hash(sequence.camera);
  if (!label_space.empty()) {  // may be a path; files have the name
    const kys::LabelSpace labels = kys::load_label_space(label_space);
    expected.label_space = labels.name();
    expected.label_count = labels.size();
  }
  LabelCounts counts;
  std::size_t bad = 0, missing = 0, bytes = 0;
  double labelled = 0, pixels = 0;
  for (const std::string& name : sequence.names) {
    const fs::path path = fs::path(folder) / (name + ".kysp");
    if (!path_exists(path)) {
      ++missing;
      continue;
    }
    try {
      const PriorFile file = open_checked(path, expected, counts);
      bytes += file.file_size();
      for (std::size_t c = 0; c < file.camera_count(); ++c) {
        pixels += static_cast<double>(file.width()) * file.height();
        for (const PriorSegment& s : file.segments(static_cast<CameraSide>(c))) {
          labelled += s.area;
        }
      }
    } catch (const InputError& error) {
      if (++bad <= 10) print_failure("validate_priors", {kBadInput, printable(error.what())});
    }
  }
  const std::size_t good = sequence.names.size() - missing - bad;
  std::size_t foreign = 0;
  for (const fs::path& path : list_prior_files(folder)) {
    foreign += std::find(sequence.names.begin(), sequence.names.end(), path.stem().string()) ==
               sequence.names.end();
  }
  std::printf("frames %zu, sound %zu, missing %zu, bad %zu, of other frames %zu\n",
              sequence.names.size(), good, missing, bad, foreign);
  if (good > 0) {
    std::printf("labelled %.1f %%, %.1f KB per file\n", 100 * labelled / pixels,
                static_cast<double>(bytes) / 1024.0 / static_cast<double>(good));
  }
  return bad + missing > 0 ? 2 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  return kys_slam::run_main("validate_priors", [&] { return run(argc, argv); });
}
