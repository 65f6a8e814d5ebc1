// SPDX-License-Identifier: BSD-3-Clause
#include "label_image.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <unordered_map>
#include <utility>

namespace kys_slam::ros {

namespace {

constexpr std::int32_t kFirstThing = 65536;  // instances of things, as in prior files
constexpr std::uint32_t kMostPixels = 16384;

/// One value of a row; the byte order is that of the message.
std::int32_t value_at(const std::uint8_t* pixel, std::size_t bytes, bool is_bigendian) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < bytes; ++i) {
    value = value << 8U | pixel[is_bigendian ? i : bytes - 1 - i];
  }
  return static_cast<std::int32_t>(value);
}

std::size_t bytes_of(const ImageMessage& message) {
  const std::string& encoding = message.encoding;
  if (encoding == "32SC1") return 4;
  if (encoding == "16UC1" || encoding == "mono16") return 2;
  throw InputError("segments with encoding '" + encoding + "': 16UC1, mono16 or 32SC1 expected");
}

/// Numbers segments by their first pixel.
class Segments {
 public:
  Segments(const kys::LabelSpace& space, int divisor) : divisor_(divisor) {
    for (std::size_t i = 0; i < space.size(); ++i) {
      const auto label = static_cast<std::uint16_t>(i);
      labels_[space.at(label).id] = {label, space.at(label).thing};
    }
  }

  /// Number of the segment of a value, 0: void.
  std::uint16_t number(std::int32_t value) {
    if (value == last_value_) return last_number_;
    last_value_ = value;
    const auto found = numbers_.find(value);
    last_number_ = found != numbers_.end() ? found->second : add(value);
    return last_number_;
  }
  std::vector<kys::Prior> take() { return std::move(segments_); }

 private:
  struct Label {
    std::uint16_t index = 0;
    bool thing = false;
  };

  std::uint16_t add(std::int32_t value) {
    std::uint16_t number = 0;
    const auto label = value < 0 ? labels_.end() : labels_.find(value / divisor_);
    if (label != labels_.end()) {
      if (segments_.size() == std::numeric_limits<std::uint16_t>::max()) {
        throw InputError("a label image with more than 65535 segments");
      }
      kys::Prior segment;
      segment.label = label->second.index;
      segment.instance = label->second.thing
                             ? kFirstThing + static_cast<std::int32_t>(segments_.size())
                             : segment.label;
      segments_.push_back(segment);
      number = static_cast<std::uint16_t>(segments_.size());
    }
    return numbers_[value] = number;
  }

  int divisor_;
  std::map<std::int32_t, Label> labels_;  // by number of the data set
  std::unordered_map<std::int32_t, std::uint16_t> numbers_;
  std::vector<kys::Prior> segments_;
  std::int32_t last_value_ = -1;
  std::uint16_t last_number_ = 0;
};

}  // namespace

std::shared_ptr<SegmentImage> segments_of(const ImageMessage& message, const kys::LabelSpace& space,
                                          int divisor) {
  const std::size_t bytes = bytes_of(message);
  check_bytes(message, bytes);
  if (std::max(message.width, message.height) > kMostPixels) {
    throw InputError("a label image with a side above 16384 px");
  }
  const int width = static_cast<int>(message.width), height = static_cast<int>(message.height);
  auto image = std::make_shared<SegmentImage>();
  image->map = ImageOf<std::uint16_t>::for_overwrite(width, height);
  Segments segments(space, divisor);
  bool has_values = false;
  for (int y = 0; y < height; ++y) {
    const std::uint8_t* row = message.data.data() + static_cast<std::size_t>(y) * message.step;
    for (int x = 0; x < width; ++x) {
      const std::int32_t value =
          value_at(row + static_cast<std::size_t>(x) * bytes, bytes, message.is_bigendian);
      has_values |= value > 0;
      image->map.at(x, y) = segments.number(value);
    }
  }
  image->segments = segments.take();
  if (has_values && image->segments.empty()) {
    throw InputError("a label image none of whose classes is in label space " + space.name() +
                     " (values are class * " + std::to_string(divisor) + " + instance)");
  }
  return image;
}

}  // namespace kys_slam::ros
