// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_file.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace kys_slam {

/// Decodes one PNG in memory. Common kinds (8 or 16 bits, not interlaced) are decoded with
/// libdeflate, about twice as fast as zlib; the others with libspng.
class PngDecoder {
 public:
  static bool is_png(std::span<const std::uint8_t> file);

  /// Reads the header. \throws InputError naming `name`, also for sizes above kMaxImageSide.
  PngDecoder(std::span<const std::uint8_t> file, std::string name);

  [[nodiscard]] const ImageInfo& info() const { return info_; }
  /// Bytes of one decoded row: channels * bytes per channel * width, one byte per palette index or
  /// grey value of less than 8 bits.
  [[nodiscard]] std::size_t row_bytes() const;
  /// Decodes to `out`, row_bytes() * height bytes, 16-bit samples in host byte order. Palette
  /// indices are not looked up, and grey of less than 8 bits is not scaled.
  void decode(std::uint8_t* out) const;
  /// Decodes every kind to 8-bit R, G, B.
  void decode_rgb8(RgbPixel* out) const;

 private:
  void decode_plain(std::uint8_t* out) const;
  void decode_with_spng(int format, std::uint8_t* out, std::size_t size) const;
  [[noreturn]] void fail(const std::string& what) const;

  std::span<const std::uint8_t> file_;
  std::string name_;
  ImageInfo info_;
  bool interlaced_ = false;
};

}  // namespace kys_slam
