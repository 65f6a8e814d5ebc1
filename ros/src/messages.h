// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_view.h>

#include <compare>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

/// What the ROS 2 node does, without ROS: tests need no ROS, and the node converts messages only.
namespace kys_slam::ros {

/// builtin_interfaces/Time. What goes out has the stamp of the left image, unchanged.
struct Stamp {
  std::int32_t sec = 0;
  std::uint32_t nanosec = 0;

  [[nodiscard]] std::int64_t nanoseconds() const {
    return std::int64_t{sec} * 1000000000 + std::int64_t{nanosec};
  }
  [[nodiscard]] double seconds() const { return 1e-9 * static_cast<double>(nanoseconds()); }
  friend auto operator<=>(const Stamp&, const Stamp&) = default;
};

enum class Side : std::uint8_t { kLeft, kRight };
const char* to_string(Side side);

/// sensor_msgs/Image. The pixels stay those of the message.
struct ImageMessage {
  Stamp stamp;
  std::string frame_id;  ///< of the optical frame of its camera
  std::string encoding;  ///< "mono8", "rgb8", ..
  std::uint32_t width = 0, height = 0;
  std::uint32_t step = 0;  ///< bytes from row to row
  bool is_bigendian = false;
  std::span<const std::uint8_t> data;
  std::shared_ptr<const void> owner;  ///< keeps `data` alive; null: the caller does
};

/// The pixels of a message, which must outlive the view. \throws InputError for an encoding that
/// is no grey or colour image, and for too few bytes
ImageView view_of(const ImageMessage& message);

/// \throws InputError when there are fewer bytes than rows of pixels of this size need
void check_bytes(const ImageMessage& message, std::size_t bytes_per_pixel);

}  // namespace kys_slam::ros
