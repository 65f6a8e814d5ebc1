// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_pair.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/paths.h>

#include <algorithm>
#include <limits>

#include "camera/plausible.h"
#include "io/sequence_parts.h"

namespace kys_slam {

void describe(kys::OptionList& list, ImagePairOptions& o) {
  describe(list, o.part);
  if (o.rate) list.add("image_pair.rate", *o.rate, {1e-6, 1e6}, "Hz");
}

namespace fs = std::filesystem;

namespace {

/// The unit of stamps in ns. Unix time has 19 digits in ns, 16 in us and 13 in ms; 13 and 16 digits
/// may be ns as well, since the start of a computer. Then the distance of the images decides: no
/// camera takes 1000 pairs per second, and none that is tracked takes less than one in 10 s.
/// Nothing when numbers are too close to be times.
std::optional<std::int64_t> unit_of(const fs::path& first,
                                    const std::vector<std::int64_t>& stamps) {
  constexpr std::int64_t kMillisecond = 1'000'000;  // ns
  if (stamps.size() < 2) return 1;
  std::vector<std::int64_t> apart;
  for (std::size_t i = 1; i < stamps.size(); ++i) apart.push_back(stamps[i] - stamps[i - 1]);
  const auto middle = apart.begin() + static_cast<std::ptrdiff_t>(apart.size() / 2);
  std::nth_element(apart.begin(), middle, apart.end());
  const std::size_t digits = std::to_string(stamps.front()).size();
  if (*middle < kMillisecond) {
    if (digits == 16) return 1'000;
    if (digits == 13) return kMillisecond;
    return std::nullopt;
  }
  if (digits == 16 && *middle < 10 * kMillisecond) {
    throw InputError(first.string() +
                     ": the names are time stamps in ns or in us, which cannot be told apart; give "
                     "--rate or --times");
  }
  return 1;
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
  if (!unit || stamps.back() > std::numeric_limits<std::int64_t>::max() / *unit)
    return std::nullopt;
  for (std::int64_t& stamp : stamps) stamp *= *unit;
  return stamps;
}

void set_times(const fs::path& left, const ImagePairOptions& options,
               std::vector<Sequence::Frame>& frames) {
  if (!options.times.empty()) return read_times(options.times, frames);
  const fs::path beside = left.parent_path() / "times.txt";
  if (!options.rate && path_exists(beside)) return read_times(beside, frames);
  if (!options.rate) {
    throw InputError(left.string() +
                     ": the names of the images are no time stamps; give --rate or --times");
  }
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].timestamp = static_cast<double>(i) / *options.rate;
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
      throw InputError(right.string() + ": no image has the time stamp of a left one");
    }
  } else {
    content.frames = pair_by_name(left, right);
    set_times(left, options, content.frames);
  }
  const ImageInfo info = read_image_info(content.frames.front().left);
  rig.set_image_size(info.width, info.height);
  if (const auto camera = rig.rectified()) {
    content.camera = *camera;
    require_plausible(*camera, rig.name);
  } else {
    const auto rectifier = std::make_shared<StereoRectifier>(rig.left, rig.right, rig.name);
    content.camera = rectifier->camera();
    content.T_b_c = rectifier->T_b_c();
    content.rectifier = rectifier;
  }
  return make_sequence(std::move(content), options.part, left);
}

}  // namespace kys_slam
