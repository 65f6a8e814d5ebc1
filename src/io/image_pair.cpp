// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <limits>

#include "camera/plausible.h"
#include "io/frame_times.h"
#include "io/sequence_parts.h"

namespace kys_slam {

void describe(kys::OptionList& list, ImagePairOptions& o) {
  describe(list, o.part);
  if (o.rate) list.add("image_pair.rate", *o.rate, {1e-6, 1e6}, "Hz");
}

namespace fs = std::filesystem;

namespace {

/// Units per second of names that are stamps. Names of frames have fewer digits than times in s, so
/// these are in ms, us or ns. Nothing when no unit makes them times.
std::optional<std::int64_t> unit_of(const fs::path& first, const std::vector<std::int64_t>& names) {
  if (names.size() < 2) return 1'000'000'000;
  const std::vector<std::int64_t> units = units_of_stamps({names.begin(), names.end()});
  if (units.empty()) return std::nullopt;
  if (units.size() == 1) return units.front();
  throw InputError(
      fmt::format("{}: the names are time stamps in {} or in {}, which cannot be told "
                  "apart; give --rate or --times",
                  first.string(), unit_name(units[0]), unit_name(units[1])));
}

/// ns, when every name is a stamp and they increase.
std::optional<std::vector<std::int64_t>> stamps_of(const std::vector<fs::path>& images) {
  std::vector<std::int64_t> stamps;
  for (const fs::path& image : images) {
    const std::string stem = image.stem().string();
    const auto value = parse_int(stem);
    if (stem.size() < 13 || !value || *value < 0) return std::nullopt;
    if (!stamps.empty() && *value <= stamps.back()) return std::nullopt;
    stamps.push_back(*value);
  }
  const auto unit = unit_of(images.front(), stamps);
  if (!unit) return std::nullopt;
  const std::int64_t nanoseconds = 1'000'000'000 / *unit;
  if (stamps.back() > std::numeric_limits<std::int64_t>::max() / nanoseconds) return std::nullopt;
  for (std::int64_t& stamp : stamps) stamp *= nanoseconds;
  return stamps;
}

void set_times(const fs::path& left, const ImagePairOptions& options, NamedPairs& pairs) {
  if (!options.times.empty()) return read_times(options.times, pairs);
  const fs::path beside = left.parent_path() / "times.txt";
  if (!options.rate && path_exists(beside)) return read_times(beside, pairs);
  if (!options.rate) {
    throw InputError(left.string() +
                     ": the names of the images are no time stamps; give --rate or --times");
  }
  // The rate is that of the images there are: of numbers 0, 10, 20 .. it is that of every tenth.
  const std::int64_t step = pairs.step();
  for (std::size_t i = 0; i < pairs.frames.size(); ++i) {
    pairs.frames[i].timestamp = pairs.time_of(i, *options.rate, step);
  }
}

}  // namespace

std::unique_ptr<Sequence> open_image_pair(const fs::path& left_given, const fs::path& right_given,
                                          StereoRig rig, const ImagePairOptions& options) {
  check_options(options);
  if (options.rate && !options.times.empty()) {
    throw InputError(
        "--rate and --times exclude each other: give --times alone for the time of each "
        "image, --rate alone for a constant rate");
  }
  const fs::path left = sequence_folder(left_given), right = sequence_folder(right_given);
  Sequence::Content content;
  content.name = left.parent_path().filename().string();
  content.layout = "image pair";
  const std::vector<fs::path> left_images = list_images(left), right_images = list_images(right);
  std::optional<std::vector<std::int64_t>> left_ns, right_ns;
  if (options.times.empty() && !options.rate) {
    left_ns = stamps_of(left_images);
    right_ns = stamps_of(right_images);
  }
  if (left_ns && right_ns) {
    content.paired_by_time = true;
    for (const auto& [l, r] : pair_stamps(*left_ns, *right_ns, options.part.pairing_tolerance)) {
      content.frames.push_back({left_images[l].stem().string(),
                                static_cast<double>((*left_ns)[l]) * 1e-9, left_images[l],
                                right_images[r]});
    }
    content.dropped = static_cast<std::int64_t>(left_images.size() + right_images.size() -
                                                2 * content.frames.size());
    if (content.frames.empty()) {
      throw InputError(right.string() + ": no image has the time stamp of a left one: " +
                       nearest_stamps(*left_ns, *right_ns));
    }
  } else {
    NamedPairs pairs = pair_by_name(left, right);
    set_times(left, options, pairs);
    content.dropped = pairs.dropped;
    content.frames = std::move(pairs.frames);
  }
  const ImageInfo info = read_image_info(content.frames.front().left);
  rig.set_image_size(info.width, info.height);
  if (const auto camera = rig.rectified()) {
    content.camera = *camera;
    require_plausible(*camera, rig.name, rig.unit_remedy);
  } else {
    const auto rectifier = std::make_shared<StereoRectifier>(rig.left, rig.right, rig.name);
    content.camera = rectifier->camera();
    content.T_b_c = rectifier->T_b_c();
    content.rectifier = rectifier;
  }
  return make_sequence(std::move(content), options.part, left);
}

}  // namespace kys_slam
