// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

/// Reading and writing of image files: PNG and JPEG; of images as 8-bit grey and colour also binary
/// PGM and PPM. The content decides the format, not the name. Every reader
/// throws InputError naming the file when it is missing, truncated, corrupt (checksums are
/// verified), of another kind than requested, or larger than kMaxImageSide on a side. Sizes are
/// checked before memory is allocated.
namespace kys_slam {

using RgbPixel = std::array<std::uint8_t, 3>;     ///< R, G, B
using Rgb16Pixel = std::array<std::uint16_t, 3>;  ///< R, G, B, host byte order
using RgbImage = ImageOf<RgbPixel>;
using Image16 = ImageOf<std::uint16_t>;
using Rgb16Image = ImageOf<Rgb16Pixel>;

inline constexpr int kMaxImageSide = 16384;  ///< px

/// Header of an image file.
struct ImageInfo {
  int width = 0;         ///< px
  int height = 0;        ///< px
  int channels = 0;      ///< 1 grey or palette index, 2 grey+alpha, 3 colour, 4 colour+alpha
  int bits = 0;          ///< per channel: 1, 2, 4, 8, 16
  bool indexed = false;  ///< pixels are palette indices
  bool jpeg = false;
};

/// Reads only the header.
ImageInfo read_image_info(const std::filesystem::path& path);

/// An image as 8-bit grey: grey as it is, colour by ITU-R BT.601 weights, alpha dropped.
/// \param bits  of 16-bit samples that the camera uses, 8 to 16: the upper 8 of these count
GrayImage read_gray(const std::filesystem::path& path, int bits = 16);

/// An image as 8-bit R, G, B: grey is repeated, palettes are looked up, alpha dropped.
RgbImage read_rgb(const std::filesystem::path& path);

/// 16-bit grey PNG, host byte order. Other kinds throw InputError.
Image16 read_u16(const std::filesystem::path& path);

/// 16-bit R, G, B PNG, host byte order. Other kinds throw InputError.
Rgb16Image read_rgb16(const std::filesystem::path& path);

/// Palette indices of an indexed PNG (not its colours), or the values of a grey PNG of at most 8
/// bits, or of a PNG whose three colours are equal. Other kinds throw InputError.
ImageOf<std::uint8_t> read_indexed(const std::filesystem::path& path);

/// The same from the bytes of a file; `name` is used in messages.
ImageInfo decode_image_info(std::span<const std::uint8_t> file, const std::string& name);
GrayImage decode_gray(std::span<const std::uint8_t> file, const std::string& name, int bits = 16);
/// Bits that an image of 16 bits uses, by its largest sample: 8, 10, 12, 14 or 16. 0: of another
/// kind, or black.
int used_bits(std::span<const std::uint8_t> file, const std::string& name);
RgbImage decode_rgb(std::span<const std::uint8_t> file, const std::string& name);
Image16 decode_u16(std::span<const std::uint8_t> file, const std::string& name);
Rgb16Image decode_rgb16(std::span<const std::uint8_t> file, const std::string& name);
ImageOf<std::uint8_t> decode_indexed(std::span<const std::uint8_t> file, const std::string& name);

/// Writes a PNG atomically (the same pixels give the same bytes).
/// \throws InputError "cannot write ...", also for an empty image.
void write_png(const std::filesystem::path& path, const GrayImage& image);
void write_png(const std::filesystem::path& path, const RgbImage& image);
void write_png(const std::filesystem::path& path, const Image16& image);
void write_png(const std::filesystem::path& path, const Rgb16Image& image);

/// A grey JPEG, for viewers. \param quality 1..100 \throws InputError for an empty image.
std::vector<std::uint8_t> encode_jpeg(const GrayImage& image, int quality);

}  // namespace kys_slam
