// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>

/// Little-endian numbers in byte buffers, at any alignment, on any machine.
namespace kys_slam::prior_format {

inline std::uint16_t load_u16(const std::uint8_t* p) {
  return static_cast<std::uint16_t>(p[0] | (p[1] << 8));
}
inline std::uint32_t load_u32(const std::uint8_t* p) {
  return p[0] | (std::uint32_t{p[1]} << 8) | (std::uint32_t{p[2]} << 16) |
         (std::uint32_t{p[3]} << 24);
}
inline std::uint64_t load_u64(const std::uint8_t* p) {
  return load_u32(p) | (std::uint64_t{load_u32(p + 4)} << 32);
}
inline float load_f32(const std::uint8_t* p) {
  return std::bit_cast<float>(load_u32(p));
}

/// Reads a number of a run stream: 7 bits per byte, lowest first, the top bit set on all but the
/// last byte, at most three bytes. Advances `p`. False when the number is longer or `end` is
/// reached.
inline bool load_varint(const std::uint8_t*& p, const std::uint8_t* end, std::uint32_t& value) {
  if (p != end && *p < 0x80) {  // most are short
    value = *p++;
    return true;
  }
  value = 0;
  for (int shift = 0; shift < 21; shift += 7) {
    if (p == end) return false;
    const std::uint8_t byte = *p++;
    value |= std::uint32_t{byte & 0x7Fu} << shift;
    if (byte < 0x80) return true;
  }
  return false;
}

/// The same for a stream that has been checked.
inline std::uint32_t load_checked_varint(const std::uint8_t*& p) {
  std::uint32_t byte = *p++;
  if (byte < 0x80) return byte;
  std::uint32_t value = byte & 0x7F;
  byte = *p++;
  value |= (byte & 0x7F) << 7;
  if (byte < 0x80) return value;
  return value | (std::uint32_t{*p++} << 14);
}

}  // namespace kys_slam::prior_format
