#include "io/sequence_parts.h"

#include <fmt/format.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/image_view.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/paths.h>
#include <kys_slam/util/read_bytes.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>

#include "camera/kitti_calibration.h"
#include "io/frame_times.h"

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

using Names = std::vector<std::vector<std::string>>;  // numbers of every name

Names all_numbers(const std::vector<fs::path>& images) {
  Names names;
  names.reserve(images.size());
  for (const fs::path& image : images) names.push_back(numbers_of(image));
  return names;
}

/// Which numbers tell frames apart: the last one, and those before that are not the same in all
/// names of a camera. (A number of the camera is.)
std::vector<bool> telling_numbers(const Names& left, const Names& right) {
  const std::size_t count = left.front().size();
  std::vector<bool> telling(count, false);
  telling.back() = true;
  for (const Names* names : {&left, &right}) {
    for (const auto& numbers : *names) {
      if (numbers.size() != count) return {};
      for (std::size_t k = 0; k + 1 < count; ++k) {
        if (numbers[k] != names->front()[k]) telling[k] = true;
      }
    }
  }
  return telling;
}

/// What images of one frame have in common.
std::string key_of(const std::vector<std::string>& numbers, const std::vector<bool>& telling) {
  if (telling.empty()) return numbers.back();
  std::string key;
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    if (telling[k]) key += numbers[k] + "_";
  }
  return key;
}

/// The last of the numbers in names that increases from frame to frame; empty: there is none.
/// Numbers of more digits are dates or times.
std::vector<std::int64_t> increasing_numbers(const Names& names) {
  constexpr std::size_t kMostDigits = 9;
  for (std::size_t k = names.front().size(); k-- > 0;) {
    std::vector<std::int64_t> numbers;
    for (const auto& name : names) {
      const auto number =
          k < name.size() && name.size() == names.front().size() && name[k].size() <= kMostDigits
              ? parse_int(name[k])
              : std::nullopt;
      if (!number || (!numbers.empty() && *number <= numbers.back())) break;
      numbers.push_back(*number);
    }
    if (numbers.size() == names.size()) return numbers;
  }
  return {};
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

NamedPairs pair_by_name(const fs::path& left, const fs::path& right) {
  const std::vector<fs::path> left_images = list_images(left);
  const std::vector<fs::path> right_images = list_images(right);
  const Names left_numbers = all_numbers(left_images), right_numbers = all_numbers(right_images);
  const std::vector<bool> telling = telling_numbers(left_numbers, right_numbers);
  std::map<std::string, std::size_t> partners;
  for (std::size_t i = 0; i < right_images.size(); ++i) {
    const std::string key = key_of(right_numbers[i], telling);
    if (const auto [other, is_new] = partners.emplace(key, i); !is_new) {
      throw InputError(right_images[i].string() + ": its name has the same number as " +
                       right_images[other->second].filename().string());
    }
  }
  NamedPairs pairs;
  pairs.left_images = left_images.size();
  Names used;
  for (std::size_t i = 0; i < left_images.size(); ++i) {
    const auto partner = partners.find(key_of(left_numbers[i], telling));
    if (partner == partners.end()) continue;
    const fs::path& right_image = right_images[partner->second];
    partners.erase(partner);
    pairs.frames.push_back({left_images[i].stem().string(), 0, left_images[i], right_image});
    pairs.positions.push_back(i);
    used.push_back(left_numbers[i]);
  }
  const std::size_t count = pairs.frames.size(),
                    most = std::max(left_images.size(), right_images.size());
  if (2 * count < most) {
    throw InputError(
        fmt::format("{}: {} images, {} has {}, and only {} have the same number in their name",
                    right.string(), right_images.size(), left.string(), left_images.size(), count));
  }
  pairs.dropped = static_cast<std::int64_t>(left_images.size() + right_images.size() - 2 * count);
  pairs.numbers = increasing_numbers(used);
  return pairs;
}

std::size_t NamedPairs::row_of(std::size_t frame, std::size_t rows, const fs::path& file,
                               const char* what) const {
  if (rows == left_images) return positions[frame];
  if (!numbers.empty() && static_cast<std::size_t>(numbers.back()) < rows) {
    return static_cast<std::size_t>(numbers[frame]);
  }
  throw InputError(
      fmt::format("{}: {} {}, but there are {} images", file.string(), rows, what, left_images));
}

double NamedPairs::time_of(std::size_t frame, double rate, std::int64_t step) const {
  if (numbers.empty()) return static_cast<double>(frame) / rate;
  return static_cast<double>(numbers[frame] - numbers.front()) / (static_cast<double>(step) * rate);
}

std::int64_t NamedPairs::step() const {
  std::vector<double> steps;
  for (std::size_t i = 1; i < numbers.size(); ++i) {
    steps.push_back(static_cast<double>(numbers[i] - numbers[i - 1]));
  }
  return steps.empty() ? 1 : static_cast<std::int64_t>(lower_median(std::move(steps)));
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
