// SPDX-License-Identifier: BSD-3-Clause
#include "label_image.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

namespace kys_slam::ros {

namespace {

constexpr std::int32_t kFirstThing = 65536;  // instances of things, as in prior files
constexpr std::uint32_t kMostPixels = 16384;
constexpr std::size_t kLeastPixels =
    150;  // of a connected part of a thing, as in segment_outputs.py

using Values = ImageOf<std::int32_t>;

/// \throws InputError for other encodings
std::size_t bytes_of(const ImageMessage& message) {
  const std::string& encoding = message.encoding;
  if (encoding == "32SC1") return 4;
  if (encoding == "16UC1" || encoding == "mono16") return 2;
  if (encoding == "8UC1" || encoding == "mono8") return 1;
  throw InputError("segments with encoding '" + encoding +
                   "': mono8, 8UC1, mono16, 16UC1 or 32SC1 expected");
}

/// The values of all pixels; the byte order is that of the message.
Values values_of(const ImageMessage& message, std::size_t bytes) {
  check_bytes(message, bytes);
  if (std::max(message.width, message.height) > kMostPixels) {
    throw InputError("a label image with a side above 16384 px");
  }
  Values values =
      Values::for_overwrite(static_cast<int>(message.width), static_cast<int>(message.height));
  for (int y = 0; y < values.height(); ++y) {
    const std::uint8_t* pixel = message.data.data() + static_cast<std::size_t>(y) * message.step;
    for (int x = 0; x < values.width(); ++x, pixel += bytes) {
      std::uint32_t value = 0;
      for (std::size_t i = 0; i < bytes; ++i) {
        value = value << 8U | pixel[message.is_bigendian ? i : bytes - 1 - i];
      }
      values.at(x, y) = static_cast<std::int32_t>(value);
    }
  }
  return values;
}

/// What a number of the data set means.
struct Label {
  std::uint16_t index = 0;
  bool thing = false;
};
using Labels = std::unordered_map<std::int32_t, Label>;

Labels labels_of(const kys::LabelSpace& space) {
  Labels labels;
  for (std::size_t i = 0; i < space.size(); ++i) {
    const auto index = static_cast<std::uint16_t>(i);
    labels[space.at(index).id] = {index, space.at(index).thing};
  }
  return labels;
}

/// The segments found so far.
class Segments {
 public:
  /// Number of a new one. \throws InputError when there are too many
  std::uint16_t add(const Label& label) {
    if (segments_.size() == std::numeric_limits<std::uint16_t>::max()) {
      throw InputError("a label image with more than 65535 segments");
    }
    kys::Prior segment;
    segment.label = label.index;
    segment.instance =
        label.thing ? kFirstThing + static_cast<std::int32_t>(segments_.size()) : label.index;
    segments_.push_back(segment);
    return static_cast<std::uint16_t>(segments_.size());
  }
  std::vector<kys::Prior> take() { return std::move(segments_); }

 private:
  std::vector<kys::Prior> segments_;
};

/// Equal values are one segment.
void number_values(const Values& values, int divisor, const Labels& labels, Segments& segments,
                   SegmentImage& image) {
  std::unordered_map<std::int32_t, std::uint16_t> numbers;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::int32_t value = values.data()[i];
    const auto [entry, is_new] = numbers.try_emplace(value, std::uint16_t{0});
    if (is_new && value >= 0) {
      const auto label = labels.find(value / divisor);
      if (label != labels.end()) entry->second = segments.add(label->second);
    }
    image.map.data()[i] = entry->second;
  }
}

/// Pixels (y * width + x) of equal value that are connected with the first one by their sides.
std::vector<std::size_t> connected(const Values& values, std::size_t first,
                                   std::vector<std::uint8_t>& seen) {
  const auto width = static_cast<std::size_t>(values.width());
  std::vector<std::size_t> part = {first};
  seen[first] = 1;
  const auto visit = [&](bool inside, std::size_t at) {
    if (!inside || seen[at] != 0 || values.data()[at] != values.data()[first]) return;
    seen[at] = 1;
    part.push_back(at);
  };
  for (std::size_t k = 0; k < part.size(); ++k) {
    const std::size_t at = part[k];
    visit(at % width > 0, at - 1);
    visit(at % width + 1 < width, at + 1);
    visit(at >= width, at - width);
    visit(at + width < values.size(), at + width);
  }
  return part;
}

/// A class of stuff is one segment, connected parts of things are segments.
void number_classes(const Values& values, const Labels& labels, Segments& segments,
                    SegmentImage& image) {
  std::unordered_map<std::int32_t, std::uint16_t> stuff;
  std::vector<std::uint8_t> seen(values.size(), 0);
  std::fill_n(image.map.data(), image.map.size(), std::uint16_t{0});
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::int32_t value = values.data()[i];
    const auto label = labels.find(value);
    if (label == labels.end() || seen[i] != 0) continue;
    if (!label->second.thing) {
      std::uint16_t& number = stuff[value];
      if (number == 0) number = segments.add(label->second);
      image.map.data()[i] = number;
      continue;
    }
    const std::vector<std::size_t> part = connected(values, i, seen);
    if (part.size() < kLeastPixels) continue;
    const std::uint16_t number = segments.add(label->second);
    for (const std::size_t at : part) image.map.data()[at] = number;
  }
}

}  // namespace

std::shared_ptr<SegmentImage> segments_of(const ImageMessage& message, const kys::LabelSpace& space,
                                          int divisor) {
  const std::size_t bytes = bytes_of(message);
  const Values values = values_of(message, bytes);
  const Labels labels = labels_of(space);
  auto image = std::make_shared<SegmentImage>();
  image->map = ImageOf<std::uint16_t>::for_overwrite(values.width(), values.height());
  Segments segments;
  if (bytes == 1) {
    number_classes(values, labels, segments, *image);
  } else {
    number_values(values, divisor, labels, segments, *image);
  }
  image->segments = segments.take();
  const auto known = [&](std::int32_t value) {
    return value >= 0 && labels.contains(bytes == 1 ? value : value / divisor);
  };
  const std::int32_t* end = values.data() + values.size();
  if (image->segments.empty() && std::any_of(values.data(), end, [](int v) { return v > 0; }) &&
      std::none_of(values.data(), end, known)) {
    throw InputError(
        "a label image none of whose classes is in label space " + space.name() +
        (bytes == 1 ? "" : " (values are class * " + std::to_string(divisor) + " + instance)"));
  }
  return image;
}

}  // namespace kys_slam::ros
