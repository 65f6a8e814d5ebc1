// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace kys_slam::fuzz {

using Bytes = std::span<const std::uint8_t>;

/// One reader of files from outside, as fuzzing sees it.
struct Reader {
  std::string_view name;  ///< also of its folder of seeds
  /// Reads the bytes. They are refused with InputError or kys::Error, which is swallowed, or what
  /// came of them is used; everything else (another exception, abort) is a finding.
  void (*read)(Bytes);
  /// Largest memory asked for at once per byte of input, beside kFreeBytes.
  double bytes_per_byte = 1100;  // what deflate can do
};

inline constexpr double kFreeBytes = 4 << 20;

std::span<const Reader> readers();

/// Null: there is none of that name.
const Reader* find_reader(std::string_view name);

}  // namespace kys_slam::fuzz
