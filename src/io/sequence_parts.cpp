// SPDX-License-Identifier: BSD-3-Clause
#include "io/sequence_parts.h"

#include <fmt/format.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_view.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "camera/kitti_calibration.h"
#include "io/frame_times.h"

namespace kys_slam {

void describe(kys::OptionList& list, SequenceOptions& o) {
  list.add("sequence.start", o.start, {0, 1e9}, "frames");
  if (o.frames) list.add("sequence.frames", *o.frames, {1, 1e9}, "frames");
  list.add("sequence.pairing_tolerance", o.pairing_tolerance, {0, 1e3}, "s");
}
namespace fs = std::filesystem;

fs::path sequence_folder(const fs::path& folder) {
  std::error_code error;
  fs::path path = fs::absolute(folder, error).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  if (!path_exists(path)) throw InputError(folder.string() + ": no such folder");
  if (!is_folder(path)) throw InputError(folder.string() + ": not a folder");
  return path;
}

std::vector<fs::path> list_images(const fs::path& folder) {
  std::vector<fs::path> images;
  std::string other;  // extension of images that are not read
  for (const fs::path& path : list_folder(folder)) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    constexpr std::array kRead{".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm"};
    constexpr std::array kOthers{".bmp", ".tif", ".tiff", ".webp", ".raw", ".gif", ".exr"};
    if (std::find(kRead.begin(), kRead.end(), extension) != kRead.end()) {
      images.push_back(path);
    } else if (std::find(kOthers.begin(), kOthers.end(), extension) != kOthers.end()) {
      other = extension;
    }
  }
  if (images.empty()) {
    throw InputError(folder.string() + ": no PNG, JPEG or PGM images" +
                     (other.empty() ? "" : ", but others (" + other + "): convert them to PNG"));
  }
  sort_frames(images);
  for (std::size_t i = 1; i < images.size(); ++i) {
    if (compare_names(images[i - 1].stem().native(), images[i].stem().native()) == 0) {
      throw InputError(images[i].string() + ": the same frame as " +
                       images[i - 1].filename().string());
    }
  }
  return images;
}

std::vector<std::pair<std::size_t, std::size_t>> pair_stamps(std::span<const std::int64_t> left,
                                                             std::span<const std::int64_t> right,
                                                             double tolerance) {
  const auto limit = static_cast<std::int64_t>(std::llround(tolerance * 1e9));
  const auto apart = [&](std::size_t l, std::size_t r) { return std::abs(right[r] - left[l]); };
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t l = 0, r = 0; l < left.size() && r < right.size();) {
    const std::int64_t difference = right[r] - left[l];
    // A later image may be nearer.
    if (r + 1 < right.size() && apart(l, r + 1) < apart(l, r)) {
      ++r;
    } else if (l + 1 < left.size() && apart(l + 1, r) < apart(l, r)) {
      ++l;
    } else if (difference < -limit) {
      ++r;
    } else if (difference > limit) {
      ++l;
    } else {
      pairs.emplace_back(l, r);
      ++l, ++r;
    }
  }
  return pairs;
}

std::string nearest_stamps(std::span<const std::int64_t> left,
                           std::span<const std::int64_t> right) {
  std::int64_t nearest = std::numeric_limits<std::int64_t>::max();
  for (std::size_t l = 0, r = 0; l < left.size() && r < right.size();) {
    nearest = std::min(nearest, std::abs(right[r] - left[l]));
    ++(left[l] < right[r] ? l : r);
  }
  return fmt::format(
      "{} left and {} right images, of which the nearest are {:.6g} s apart; "
      "--tolerance S allows more",
      left.size(), right.size(), static_cast<double>(nearest) * 1e-9);
}

void read_times(const fs::path& file, NamedPairs& pairs) {
  const std::vector<double> times = read_time_file(file);
  for (std::size_t i = 0; i < pairs.frames.size(); ++i) {
    pairs.frames[i].timestamp = times[pairs.row_of(i, times.size(), file, "time stamps")];
  }
}

std::vector<double> kitti_calibration_row(const fs::path& file,
                                          const std::vector<std::string>& names,
                                          std::size_t count) {
  const TextTable table(file);
  for (const std::string& name : names) {
    std::vector<double> found;
    for (const TextRow& row : table.rows()) {
      if (row.fields[0] != name && row.fields[0] != name + ":") continue;
      std::vector<double> values = table.numbers(row, 1);
      if (values.size() != count) {
        table.fail(row, name + " has " + std::to_string(values.size()) + " numbers instead of " +
                            std::to_string(count));
      }
      if (!found.empty() && values != found) table.fail(row, "another " + name + " than before");
      found = std::move(values);
    }
    if (!found.empty()) return found;
  }
  throw InputError(file.string() + ": no line '" + names.front() + "'");
}

Eigen::Matrix<double, 3, 4> kitti_projection(const fs::path& file, const std::string& name) {
  const std::vector<double> values = kitti_calibration_row(file, {name}, 12);
  return Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(values.data());
}

StereoCamera kitti_camera(const fs::path& calibration, const std::string& left,
                          const std::string& right, const fs::path& first_image) {
  const auto P_left = kitti_projection(calibration, left);
  const auto P_right = kitti_projection(calibration, right);
  const ImageInfo info = read_image_info(first_image);
  return stereo_camera_from_projections(P_left, P_right, info.width, info.height,
                                        calibration.string());
}

void make_relative_to_first(std::vector<TimedPose>& poses) {
  if (poses.empty()) return;
  const Rigid3 T_first_w = poses.front().T_w_c.inverse();
  for (TimedPose& pose : poses) pose.T_w_c = T_first_w * pose.T_w_c;
}

namespace {

/// Bits that 16-bit images use, by some all over the recording: the first ones may be dark.
void find_bits(const fs::path& folder, Sequence::Content& content) {
  constexpr std::size_t kSamples = 6;
  int bits = 0;
  const std::size_t last = content.frames.size() - 1;
  for (std::size_t k = 0; k < kSamples && bits < 16; ++k) {
    const Sequence::Frame& frame = content.frames[last * k / (kSamples - 1)];
    for (const fs::path& image : {frame.left, frame.right}) {
      try {
        const std::vector<std::uint8_t> bytes = read_bytes(image);
        if (k == 0 && decode_image_info(bytes, image.string()).bits != 16) return;
        bits = std::max(bits, used_bits(bytes, image.string()));
      } catch (const InputError&) {  // told when it is its turn
      }
    }
  }
  if (bits > 0) content.bits = bits;
  const std::string note = note_of_bits(bits);
  if (!note.empty()) content.notes.push_back(folder.string() + ": " + note);
}

}  // namespace

std::unique_ptr<Sequence> make_sequence(Sequence::Content content, const SequenceOptions& options,
                                        const fs::path& folder) {
  const auto count = static_cast<std::int64_t>(content.frames.size());
  if (options.pair != CameraPair::kFirst && content.layout != "KITTI odometry") {
    throw InputError(folder.string() + ": has one camera pair; a choice is for KITTI odometry");
  }
  if (options.start < 0 || options.start >= count) {
    throw InputError(folder.string() + ": cannot start at frame " + std::to_string(options.start) +
                     " of " + std::to_string(count));
  }
  if (options.frames && *options.frames <= 0) {
    throw InputError(folder.string() + ": cannot use " + std::to_string(*options.frames) +
                     " frames");
  }
  check_options(options);
  for (const TimedPose& pose : content.ground_truth) {
    if (!pose.T_w_c.is_finite()) {
      throw InputError(folder.string() + ": ground truth with numbers that are too large");
    }
  }
  find_bits(folder, content);
  const std::int64_t used =
      options.frames ? std::min(*options.frames, count - options.start) : count - options.start;
  const auto cut = [&](auto& list) {
    list.erase(list.begin(), list.begin() + options.start);
    list.resize(static_cast<std::size_t>(used));
  };
  // Ground truth with stamps of its own (EuRoC) is left whole.
  const auto same_stamp = [](const TimedPose& pose, const Sequence::Frame& frame) {
    return pose.timestamp == frame.timestamp;
  };
  if (std::equal(content.ground_truth.begin(), content.ground_truth.end(), content.frames.begin(),
                 content.frames.end(), same_stamp)) {
    cut(content.ground_truth);
  }
  cut(content.frames);
  return std::make_unique<Sequence>(std::move(content), options.start);
}

}  // namespace kys_slam
