// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

namespace kys {

/// A 256-bit binary descriptor (ORB): bit i is bit (i mod 64) of word i / 64.
struct Descriptor {
  std::array<std::uint64_t, 4> words{};

  friend bool operator==(const Descriptor&, const Descriptor&) = default;
};

}  // namespace kys
