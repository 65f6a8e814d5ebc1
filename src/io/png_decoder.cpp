// SPDX-License-Identifier: BSD-3-Clause
#include "io/png_decoder.h"

#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <libdeflate.h>
#include <spng.h>

#include <bit>
#include <cstring>
#include <memory>
#include <vector>

#include "io/png_unfilter.h"

namespace kys_slam {
namespace {

constexpr std::uint8_t kSignature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};

std::uint32_t big_endian(const std::uint8_t* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

struct SpngDelete {
  void operator()(spng_ctx* context) const { spng_ctx_free(context); }
};
struct DecompressorDelete {
  void operator()(libdeflate_decompressor* d) const { libdeflate_free_decompressor(d); }
};

int channels_of(int color_type) {
  switch (color_type) {
    case SPNG_COLOR_TYPE_TRUECOLOR:
      return 3;
    case SPNG_COLOR_TYPE_GRAYSCALE_ALPHA:
      return 2;
    case SPNG_COLOR_TYPE_TRUECOLOR_ALPHA:
      return 4;
    default:
      return 1;
  }
}

bool depth_fits(int color_type, int bits) {
  switch (color_type) {
    case SPNG_COLOR_TYPE_GRAYSCALE:
      return bits == 1 || bits == 2 || bits == 4 || bits == 8 || bits == 16;
    case SPNG_COLOR_TYPE_INDEXED:
      return bits == 1 || bits == 2 || bits == 4 || bits == 8;
    case SPNG_COLOR_TYPE_TRUECOLOR:
    case SPNG_COLOR_TYPE_GRAYSCALE_ALPHA:
    case SPNG_COLOR_TYPE_TRUECOLOR_ALPHA:
      return bits == 8 || bits == 16;
    default:
      return false;
  }
}

/// The compressed image data: all IDAT chunks one after the other, their checksums verified.
/// Sets `error` instead when the file is damaged.
std::vector<std::uint8_t> collect_image_data(std::span<const std::uint8_t> file,
                                             std::string& error) {
  std::vector<std::uint8_t> data;
  std::size_t at = sizeof kSignature;
  while (true) {
    if (file.size() - at < 12) {
      error = "truncated PNG";
      return {};
    }
    const std::size_t length = big_endian(&file[at]);
    const std::uint8_t* type = &file[at + 4];
    if (length > file.size() - at - 12) {
      error = "truncated PNG";
      return {};
    }
    if (std::memcmp(type, "IEND", 4) == 0) return data;
    if (std::memcmp(type, "IDAT", 4) == 0) {
      if (libdeflate_crc32(0, type, length + 4) != big_endian(type + 4 + length)) {
        error = "corrupt PNG (checksum)";
        return {};
      }
      if (data.empty()) data.reserve(file.size() - at);
      data.insert(data.end(), type + 4, type + 4 + length);
    }
    at += 12 + length;
  }
}

void swap_to_host_order(std::uint8_t* data, std::size_t size) {
  if constexpr (std::endian::native == std::endian::big) return;
  for (std::size_t i = 0; i + 1 < size; i += 2) std::swap(data[i], data[i + 1]);
}

/// Rows of packed 1, 2 or 4-bit values to one byte per value.
void unpack_row(const std::uint8_t* in, int bits, int width, std::uint8_t* out) {
  const unsigned mask = (1U << bits) - 1U;
  for (int x = 0; x < width; ++x) {
    const int bit = x * bits;
    out[x] = static_cast<std::uint8_t>((in[bit / 8] >> (8 - bits - bit % 8)) & mask);
  }
}

}  // namespace

bool PngDecoder::is_png(std::span<const std::uint8_t> file) {
  return file.size() >= sizeof kSignature &&
         std::memcmp(file.data(), kSignature, sizeof kSignature) == 0;
}

PngDecoder::PngDecoder(std::span<const std::uint8_t> file, std::string name)
    : file_(file), name_(std::move(name)) {
  constexpr std::size_t kHeaderEnd = 8 + 8 + 13 + 4;
  if (!is_png(file_)) fail("not a PNG");
  if (file_.size() < kHeaderEnd) fail("truncated PNG");
  const std::uint8_t* header = &file_[16];
  if (big_endian(&file_[8]) != 13 || std::memcmp(&file_[12], "IHDR", 4) != 0 ||
      libdeflate_crc32(0, &file_[12], 17) != big_endian(header + 13)) {
    fail("corrupt PNG header");
  }
  const std::uint32_t width = big_endian(header);
  const std::uint32_t height = big_endian(header + 4);
  const int bits = header[8];
  const int color_type = header[9];
  if (width == 0 || height == 0 || width > kMaxImageSide || height > kMaxImageSide) {
    fail("image size " + std::to_string(width) + "x" + std::to_string(height) + " is outside 1.." +
         std::to_string(kMaxImageSide));
  }
  if (!depth_fits(color_type, bits) || header[10] != 0 || header[11] != 0 || header[12] > 1) {
    fail("corrupt PNG header");
  }
  interlaced_ = header[12] == 1;
  info_ = {static_cast<int>(width),
           static_cast<int>(height),
           channels_of(color_type),
           bits,
           color_type == SPNG_COLOR_TYPE_INDEXED,
           false};
  // Deflate cannot shrink data more than 1032 times: a small file that claims a large image is
  // refused before memory is taken for it.
  const std::size_t packed_row = (width * info_.channels * static_cast<std::size_t>(bits) + 7) / 8;
  if (packed_row * height / 1040 > file_.size()) fail("truncated PNG");
  check_memory(name_, 2 * row_bytes() * height);  // inflated, and the pixels
}

void PngDecoder::fail(const std::string& what) const {
  throw InputError(name_ + ": " + what);
}

std::size_t PngDecoder::row_bytes() const {
  return static_cast<std::size_t>(info_.width) * info_.channels * (info_.bits == 16 ? 2 : 1);
}

void PngDecoder::decode(std::uint8_t* out) const {
  const std::size_t size = row_bytes() * info_.height;
  if (info_.bits >= 8 && !interlaced_) {
    decode_plain(out);
  } else if (info_.bits >= 8) {
    decode_with_spng(SPNG_FMT_PNG, out, size);
  } else {
    const std::size_t packed_row = (static_cast<std::size_t>(info_.width) * info_.bits + 7) / 8;
    std::vector<std::uint8_t> packed(packed_row * info_.height);
    decode_with_spng(SPNG_FMT_PNG, packed.data(), packed.size());
    for (int y = 0; y < info_.height; ++y) {
      unpack_row(&packed[y * packed_row], info_.bits, info_.width, out + y * row_bytes());
    }
  }
}

void PngDecoder::decode_rgb8(RgbPixel* out) const {
  static_assert(sizeof(RgbPixel) == 3);
  const std::size_t size = std::size_t{3} * info_.width * info_.height;
  if (info_.channels == 3 && info_.bits == 8) {
    decode(out->data());
  } else {
    decode_with_spng(SPNG_FMT_RGB8, out->data(), size);
  }
}

void PngDecoder::decode_plain(std::uint8_t* out) const {
  std::string error;
  const std::vector<std::uint8_t> compressed = collect_image_data(file_, error);
  if (!error.empty()) fail(error);
  const std::size_t row = row_bytes();
  const std::size_t filtered_size = (row + 1) * info_.height;
  const std::unique_ptr<std::uint8_t[]> filtered(new std::uint8_t[filtered_size]);
  const std::unique_ptr<libdeflate_decompressor, DecompressorDelete> decompressor(
      libdeflate_alloc_decompressor());
  if (!decompressor) throw std::bad_alloc();
  std::size_t written = 0;
  const libdeflate_result result =
      libdeflate_zlib_decompress(decompressor.get(), compressed.data(), compressed.size(),
                                 filtered.get(), filtered_size, &written);
  if (result != LIBDEFLATE_SUCCESS || written != filtered_size) {
    fail("corrupt PNG (compressed data)");
  }
  const std::size_t bpp = static_cast<std::size_t>(info_.channels) * (info_.bits / 8);
  const std::uint8_t* above = nullptr;
  for (int y = 0; y < info_.height; ++y) {
    const std::uint8_t* in = filtered.get() + y * (row + 1);
    std::uint8_t* to = out + y * row;
    if (!png_unfilter_row(in[0], in + 1, above, row, bpp, to)) fail("corrupt PNG (row filter)");
    above = to;
  }
  if (info_.bits == 16) swap_to_host_order(out, row * info_.height);
}

void PngDecoder::decode_with_spng(int format, std::uint8_t* out, std::size_t size) const {
  const std::unique_ptr<spng_ctx, SpngDelete> context(spng_ctx_new(0));
  if (!context) throw std::bad_alloc();
  spng_set_image_limits(context.get(), kMaxImageSide, kMaxImageSide);
  spng_set_crc_action(context.get(), SPNG_CRC_ERROR, SPNG_CRC_DISCARD);
  std::size_t needed = 0;
  int error = spng_set_png_buffer(context.get(), file_.data(), file_.size());
  if (error == 0) error = spng_decoded_image_size(context.get(), format, &needed);
  if (error == 0 && needed != size) error = SPNG_EBUFSIZ;
  if (error == 0) error = spng_decode_image(context.get(), out, size, format, 0);
  if (error == SPNG_IO_EOF || error == SPNG_EIDAT_TOO_SHORT) fail("truncated PNG");
  if (error != 0) fail(std::string("corrupt PNG (") + spng_strerror(error) + ")");
}

}  // namespace kys_slam
