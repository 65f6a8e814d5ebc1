// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/util/parse_number.h>

#include <algorithm>
#include <cstdlib>
#include <map>

#include "io/frame_times.h"
#include "io/sequence_parts.h"

namespace kys_slam {
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

/// Whether one camera's images are numbered from 0 and the other one's from 1: the same number is
/// not of the same moment then.
bool count_from_0_and_1(const Names& left, const Names& right) {
  const std::vector<std::int64_t> l = increasing_numbers(left), r = increasing_numbers(right);
  if (l.size() < 2 || l.size() != r.size() || std::min(l[0], r[0]) != 0) return false;
  const std::int64_t offset = r[0] - l[0];
  if (std::abs(offset) != 1) return false;
  return std::equal(l.begin(), l.end(), r.begin(),
                    [&](std::int64_t a, std::int64_t b) { return b - a == offset; });
}

}  // namespace

NamedPairs pair_by_name(const fs::path& left, const fs::path& right) {
  const std::vector<fs::path> left_images = list_images(left);
  const std::vector<fs::path> right_images = list_images(right);
  const Names left_numbers = all_numbers(left_images), right_numbers = all_numbers(right_images);
  if (count_from_0_and_1(left_numbers, right_numbers)) {
    throw InputError(
        right.string() +
        ": one camera's images are numbered from 0, the other one's from 1; give images of "
        "one moment the same number (or remove those at the ends without a partner)");
  }
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
  // Numbers count from 0 or from 1: a last one that is the number of rows counts from 1, a first
  // one that is 1 may do either.
  if (!numbers.empty()) {
    const auto number = static_cast<std::size_t>(numbers[frame]);
    const auto last = static_cast<std::size_t>(numbers.back());
    if (numbers.front() > 0 && last == rows) return number - 1;
    if (numbers.front() != 1 && last < rows) return number;
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

}  // namespace kys_slam
