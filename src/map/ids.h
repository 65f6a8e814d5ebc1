// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <limits>

namespace kys_slam {

/// A typed index: assigned in increasing order, never reused. Default-constructed: no object.
template <typename Tag>
struct Id {
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t value = kNone;

  [[nodiscard]] constexpr bool valid() const { return value != kNone; }
  friend constexpr auto operator<=>(const Id&, const Id&) = default;
};

using KeyFrameId = Id<struct KeyFrameTag>;
using LandmarkId = Id<struct LandmarkTag>;

}  // namespace kys_slam
