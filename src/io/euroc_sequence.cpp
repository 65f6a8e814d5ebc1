// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/stereo_rig.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/text_table.h>

#include <array>
#include <cmath>
#include <set>
#include <string_view>

#include "io/frame_times.h"
#include "io/sequence_parts.h"

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

struct Shot {
  std::int64_t nanoseconds = 0;
  fs::path image;
};

double seconds(std::int64_t nanoseconds) {
  return static_cast<double>(nanoseconds) * 1e-9;
}

struct Shots {
  std::vector<Shot> shots;
  std::int64_t missing = 0;  // listed, but not there
};

/// Time stamps of the first column in ns: they are, or in the only other unit that makes them times
/// of a camera. \throws InputError naming the row of a stamp that is no number
std::vector<std::int64_t> nanoseconds_of(const TextTable& table) {
  std::vector<std::int64_t> whole;
  std::vector<double> stamps;
  for (const TextRow& row : table.rows()) {
    stamps.push_back(table.number(row, 0));
    if (const auto number = parse_int(row.fields[0])) whole.push_back(*number);
  }
  const bool all_whole = whole.size() == stamps.size();
  const std::vector<std::int64_t> units = units_of_stamps(stamps);
  constexpr std::int64_t kPerSecond = 1'000'000'000;
  const bool is_other = units.size() == 1 && units[0] != kPerSecond;
  if (all_whole && !is_other) return whole;
  if (!is_other && !stamps.empty() && units.empty()) {
    table.fail(table.rows().front(), "no unit makes the first column time stamps of a camera");
  }
  const auto unit = static_cast<double>(is_other ? units[0] : kPerSecond);
  std::vector<std::int64_t> rounded;
  for (const double stamp : stamps) rounded.push_back(std::llround(stamp / unit * 1e9));
  return rounded;
}

/// The rows "timestamp,file name" of one camera, without those whose image is missing.
/// \throws InputError naming the first of these when they are most
Shots read_shots(const fs::path& camera) {
  constexpr std::int64_t kLeastInterval = 100000;  // ns; seconds since 1970 have steps of 238 ns
  const TextTable table(camera / "data.csv", TableStyle::kSpreadsheet);
  const std::vector<std::int64_t> stamps = nanoseconds_of(table);
  std::vector<Shot> shots;
  std::size_t first_missing = 0;
  std::set<std::string_view> names;
  for (const TextRow& row : table.rows()) {
    if (row.fields.size() != 2) table.fail(row, "expected 'timestamp,file name'");
    fs::path name(row.fields[1]);
    if (name.parent_path() == "data") name = name.filename();
    if (name.has_parent_path()) table.fail(row, "file name with a folder");
    shots.push_back({stamps[shots.size()], camera / "data" / name});
    if (shots.back().nanoseconds < 0) table.fail(row, "negative time stamp");
    if (!names.insert(row.fields[1]).second) {
      table.fail(row, "the image " + name.string() + " is listed twice");
    }
    if (shots.size() > 1) {
      const std::int64_t before = shots[shots.size() - 2].nanoseconds;
      if (shots.back().nanoseconds <= before) table.fail(row, "time stamps do not increase");
      if (shots.back().nanoseconds - before < kLeastInterval) {
        table.fail(row, std::to_string(shots.back().nanoseconds - before) +
                            " ns after the image before: cameras are slower");
      }
    }
  }
  if (shots.empty()) throw InputError(table.path().string() + ": lists no images");
  Shots there;
  for (std::size_t i = 0; i < shots.size(); ++i) {
    if (path_exists(shots[i].image)) {
      there.shots.push_back(std::move(shots[i]));
    } else if (there.missing++ == 0) {
      first_missing = i;
    }
  }
  if (2 * there.shots.size() < shots.size()) {
    table.fail(table.rows()[first_missing],
               fmt::format("the image {} is missing, as are {} of {} that are listed",
                           shots[first_missing].image.string(), there.missing, shots.size()));
  }
  return there;
}

std::vector<std::int64_t> stamps_of(const std::vector<Shot>& shots) {
  std::vector<std::int64_t> stamps;
  for (const Shot& shot : shots) stamps.push_back(shot.nanoseconds);
  return stamps;
}

void pair_by_time(const Shots& left_shots, const Shots& right_shots, const fs::path& mav,
                  double tolerance, Sequence::Content& content) {
  const std::vector<Shot>&left = left_shots.shots, &right = right_shots.shots;
  const std::vector<std::int64_t> left_ns = stamps_of(left), right_ns = stamps_of(right);
  for (const auto& [l, r] : pair_stamps(left_ns, right_ns, tolerance)) {
    content.frames.push_back({left[l].image.stem().string(), seconds(left[l].nanoseconds),
                              left[l].image, right[r].image});
  }
  content.dropped =
      static_cast<std::int64_t>(left.size() + right.size() - 2 * content.frames.size());
  content.missing = left_shots.missing + right_shots.missing;
  if (content.frames.empty()) {
    throw InputError(
        (mav / "cam1" / "data.csv").string() +
        ": no image has the time stamp of a left one: " + nearest_stamps(left_ns, right_ns));
  }
}

/// The folder that holds cam0 and cam1, given it or its parent.
fs::path find_mav(const fs::path& folder) {
  const bool inside = folder.filename() == "mav0" && !is_folder(folder / "mav0");
  fs::path mav = inside ? folder : folder / "mav0";
  if (!is_folder(mav / "cam0") || !is_folder(mav / "cam1")) {
    const bool kitti = is_folder(folder / "image_0") || is_folder(folder / "image_2");
    throw InputError(folder.string() + ": not an EuRoC sequence (no mav0/cam0 and mav0/cam1)" +
                     (kitti ? "; it is KITTI's: run_stereo_kitti reads it" : ""));
  }
  return mav;
}

/// TUM-VI has Kalibr's file beside mav0/ in place of a sensor.yaml per camera.
fs::path camchain_of(const fs::path& mav) {
  return mav.parent_path() / "dso" / "camchain.yaml";
}

bool is_tum_vi(const fs::path& mav) {
  return !path_exists(mav / "cam0" / "sensor.yaml") && path_exists(camchain_of(mav));
}

StereoRig read_rig(const fs::path& mav) {
  if (is_tum_vi(mav)) {
    const std::array<fs::path, 1> camchain{camchain_of(mav)};
    StereoRig rig = read_stereo_rig(camchain);
    rig.unit_remedy = "translations have to be in m";
    return rig;
  }
  const fs::path left = mav / "cam0" / "sensor.yaml", right = mav / "cam1" / "sensor.yaml";
  return {read_sensor_yaml(left), read_sensor_yaml(right), left.string() + ", " + right.string(),
          "the translation in T_BS has to be in m"};
}

StereoRectifier rectifier_of(const StereoRig& rig) {
  return {rig.left, rig.right, rig.name};
}

}  // namespace

Rigid3 read_euroc_T_b_c(const fs::path& folder) {
  return rectifier_of(read_rig(find_mav(sequence_folder(folder)))).T_b_c();
}

std::unique_ptr<Sequence> open_euroc_sequence(const fs::path& given,
                                              const SequenceOptions& options) {
  const fs::path folder = sequence_folder(given);
  const fs::path mav = find_mav(folder);
  Sequence::Content content;
  content.name = mav.parent_path().filename().string();
  content.layout = is_tum_vi(mav) ? "TUM-VI" : "EuRoC";
  content.paired_by_time = true;
  pair_by_time(read_shots(mav / "cam0"), read_shots(mav / "cam1"), mav, options.pairing_tolerance,
               content);
  StereoRig rig = read_rig(mav);
  // Before tables of that size are made.
  const ImageInfo image = read_image_info(content.frames.front().left);
  rig.set_image_size(image.width, image.height);
  const auto rectifier = std::make_shared<StereoRectifier>(rectifier_of(rig));
  content.camera = rectifier->camera();
  content.T_b_c = rectifier->T_b_c();
  content.rectifier = rectifier;
  const fs::path truth =
      mav / (is_tum_vi(mav) ? "mocap0" : "state_groundtruth_estimate0") / "data.csv";
  if (path_exists(truth)) {
    content.ground_truth = read_euroc_poses(truth);
    if (content.ground_truth.empty()) throw InputError(truth.string() + ": holds no poses");
    for (TimedPose& pose : content.ground_truth) pose.T_w_c = pose.T_w_c * *content.T_b_c;
  }
  return make_sequence(std::move(content), options, folder);
}

}  // namespace kys_slam
