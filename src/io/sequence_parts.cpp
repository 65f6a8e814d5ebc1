// SPDX-License-Identifier: BSD-3-Clause
#include "io/sequence_parts.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "camera/kitti_calibration.h"

namespace kys_slam {

void describe(kys::OptionList& list, SequenceOptions& o) {
  list.add("sequence.start", o.start, {0, 1e9}, "frames");
  if (o.frames) list.add("sequence.frames", *o.frames, {1, 1e9}, "frames");
  list.add("sequence.pairing_tolerance", o.pairing_tolerance, {0, 1e3}, "s");
}
namespace fs = std::filesystem;
namespace {

/// The digits a stem ends in, and those before: "000012_10" -> "000012", "10". The last is "" when
/// the stem does not end in digits.
std::vector<std::string> numbers_of(const fs::path& image) {
  std::vector<std::string> numbers;
  bool inside = false;
  for (const char c : image.stem().string()) {
    const bool digit = c >= '0' && c <= '9';
    if (digit && !inside) numbers.emplace_back();
    if (digit) numbers.back() += c;
    inside = digit;
  }
  if (!inside) numbers.emplace_back();
  return numbers;
}

/// Whether image `i` of both cameras is of one frame: all numbers in the names are the same, but
/// for one before the last that tells the cameras apart, and is the same in all names of a camera.
bool same_frame(const std::vector<fs::path>& left, const std::vector<fs::path>& right,
                std::size_t i) {
  const std::vector<std::string> a = numbers_of(left[i]), b = numbers_of(right[i]);
  if (a.back() != b.back()) return false;
  if (a.size() != b.size()) return true;
  const auto constant = [&](const std::vector<fs::path>& images, std::size_t k,
                            const std::string& number) {
    for (const fs::path& image : {images.front(), images.back()}) {
      const std::vector<std::string> numbers = numbers_of(image);
      if (k >= numbers.size() || numbers[k] != number) return false;
    }
    return true;
  };
  for (std::size_t k = 0; k + 1 < a.size(); ++k) {
    if (a[k] != b[k] && !(constant(left, k, a[k]) && constant(right, k, b[k]))) return false;
  }
  return true;
}

}  // namespace

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
  for (const fs::path& path : list_folder(folder)) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
    if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") images.push_back(path);
  }
  if (images.empty()) throw InputError(folder.string() + ": no PNG or JPEG images");
  sort_frames(images);
  for (std::size_t i = 1; i < images.size(); ++i) {
    if (compare_names(images[i - 1].stem().native(), images[i].stem().native()) == 0) {
      throw InputError(images[i].string() + ": the same frame as " +
                       images[i - 1].filename().string());
    }
  }
  return images;
}

std::vector<Sequence::Frame> pair_by_name(const fs::path& left, const fs::path& right) {
  const std::vector<fs::path> left_images = list_images(left);
  const std::vector<fs::path> right_images = list_images(right);
  if (left_images.size() != right_images.size()) {
    throw InputError(right.string() + ": " + std::to_string(right_images.size()) + " images, but " +
                     left.filename().string() + " has " + std::to_string(left_images.size()));
  }
  std::vector<Sequence::Frame> frames;
  for (std::size_t i = 0; i < left_images.size(); ++i) {
    if (!same_frame(left_images, right_images, i)) {
      throw InputError(left_images[i].string() + ": no image of this number in " + right.string());
    }
    frames.push_back({left_images[i].stem().string(), 0, left_images[i], right_images[i]});
  }
  return frames;
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

void read_times(const fs::path& file, std::vector<Sequence::Frame>& frames) {
  const TextTable table(file);
  if (table.rows().size() != frames.size()) {
    throw InputError(file.string() + ": " + std::to_string(table.rows().size()) +
                     " time stamps, but there are " + std::to_string(frames.size()) + " images");
  }
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const TextRow& row = table.rows()[i];
    frames[i].timestamp = table.number(row, 0);
    if (i > 0 && frames[i].timestamp <= frames[i - 1].timestamp) {
      table.fail(row, "time stamps do not increase");
    }
  }
}

void require_consecutive(const std::vector<Sequence::Frame>& frames) {
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const auto before = parse_int(numbers_of(frames[i - 1].left).back());
    const auto number = parse_int(numbers_of(frames[i].left).back());
    if (!before || !number || *number - *before == 1) continue;
    throw InputError(frames[i].left.string() + ": follows " +
                     frames[i - 1].left.filename().string() +
                     ", but frames of this layout have to be consecutive");
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
