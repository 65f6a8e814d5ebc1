// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/image_file.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <vector>

#include "io/jpeg_codec.h"
#include "io/luma.h"
#include "io/png_decoder.h"
#include "io/png_encoder.h"
#include "io/pnm_codec.h"

namespace kys_slam {
namespace fs = std::filesystem;
namespace {

using Bytes = std::span<const std::uint8_t>;

[[noreturn]] void fail_kind(const std::string& name, const ImageInfo& info, const char* wanted) {
  throw InputError(name + ": expected " + wanted + ", found " + std::to_string(info.channels) +
                   " channel(s) of " + std::to_string(info.bits) + " bits" +
                   (info.indexed ? " with a palette" : "") + (info.jpeg ? " (JPEG)" : ""));
}

bool is_png(Bytes file) {
  return PngDecoder::is_png(file);
}

void require_image(Bytes file, const std::string& name) {
  if (file.empty()) throw InputError(name + ": empty file");
  if (!is_png(file) && !is_jpeg(file) && !is_pnm(file)) {
    throw InputError(name + ": neither a PNG nor a JPEG image, nor PGM or PPM");
  }
}

/// The samples of a 16-bit PNG.
std::vector<std::uint16_t> decode_samples(const PngDecoder& png) {
  const ImageInfo& info = png.info();
  std::vector<std::uint16_t> samples(static_cast<std::size_t>(info.channels) * info.width *
                                     info.height);
  png.decode(reinterpret_cast<std::uint8_t*>(samples.data()));
  return samples;
}

GrayImage decode_png_gray16(const PngDecoder& png, int bits) {
  const ImageInfo& info = png.info();
  const std::vector<std::uint16_t> samples = decode_samples(png);
  GrayImage gray(info.width, info.height);
  const auto channels = static_cast<std::size_t>(info.channels);
  for (std::size_t i = 0; i < gray.size(); ++i) {
    const std::uint16_t* p = &samples[i * channels];
    gray.data()[i] =
        channels < 3 ? upper_byte(*p, bits)
                     : luma(upper_byte(p[0], bits), upper_byte(p[1], bits), upper_byte(p[2], bits));
  }
  return gray;
}

GrayImage decode_png_gray(const PngDecoder& png, int bits) {
  const ImageInfo& info = png.info();
  if (info.bits == 16) return decode_png_gray16(png, bits);
  GrayImage gray(info.width, info.height);
  if (info.channels == 1 && info.bits == 8 && !info.indexed) {
    png.decode(gray.data());
    return gray;
  }
  RgbImage rgb(info.width, info.height);
  png.decode_rgb8(rgb.data());
  for (std::size_t i = 0; i < gray.size(); ++i) {
    const RgbPixel& p = rgb.data()[i];
    gray.data()[i] = luma(p[0], p[1], p[2]);
  }
  return gray;
}

template <typename T>
void write_pixels(const fs::path& path, const ImageOf<T>& image, int channels, int bits) {
  if (image.empty()) throw InputError("cannot write " + path.string() + ": the image is empty");
  const auto png = encode_png(image.data(), image.width(), image.height(), channels, bits);
  write_file_atomic(path, png, Durable::kNo);
}

}  // namespace

ImageInfo decode_image_info(Bytes file, const std::string& name) {
  require_image(file, name);
  if (is_pnm(file)) return pnm_info(file, name);
  return is_jpeg(file) ? jpeg_info(file, name) : PngDecoder(file, name).info();
}

GrayImage decode_gray(Bytes file, const std::string& name, int bits) {
  require_image(file, name);
  if (is_pnm(file)) return decode_pnm_gray(file, name, bits);
  return is_jpeg(file) ? decode_jpeg_gray(file, name)
                       : decode_png_gray(PngDecoder(file, name), bits);
}

int used_bits(Bytes file, const std::string& name) {
  const ImageInfo info = decode_image_info(file, name);
  if (info.bits != 16) return 0;
  if (is_pnm(file)) return bits_of_largest(largest_pnm_sample(file, name));
  const std::vector<std::uint16_t> samples = decode_samples(PngDecoder(file, name));
  return bits_of_largest(*std::max_element(samples.begin(), samples.end()));
}

RgbImage decode_rgb(Bytes file, const std::string& name) {
  require_image(file, name);
  if (is_pnm(file)) return decode_pnm_rgb(file, name);
  if (is_jpeg(file)) return decode_jpeg_rgb(file, name);
  const PngDecoder png(file, name);
  RgbImage image(png.info().width, png.info().height);
  png.decode_rgb8(image.data());
  return image;
}

Image16 decode_u16(Bytes file, const std::string& name) {
  const ImageInfo info = decode_image_info(file, name);
  if (!is_png(file) || info.channels != 1 || info.bits != 16)
    fail_kind(name, info, "16-bit grey PNG");
  Image16 image(info.width, info.height);
  PngDecoder(file, name).decode(reinterpret_cast<std::uint8_t*>(image.data()));
  return image;
}

Rgb16Image decode_rgb16(Bytes file, const std::string& name) {
  static_assert(sizeof(Rgb16Pixel) == 6);
  const ImageInfo info = decode_image_info(file, name);
  if (!is_png(file) || info.channels != 3 || info.bits != 16)
    fail_kind(name, info, "16-bit RGB PNG");
  Rgb16Image image(info.width, info.height);
  PngDecoder(file, name).decode(reinterpret_cast<std::uint8_t*>(image.data()));
  return image;
}

namespace {

/// A grey image that was saved with colour channels, as painting programs do.
ImageOf<std::uint8_t> decode_equal_channels(Bytes file, const std::string& name) {
  const PngDecoder png(file, name);
  RgbImage rgb(png.info().width, png.info().height);
  png.decode_rgb8(rgb.data());
  ImageOf<std::uint8_t> image(rgb.width(), rgb.height());
  for (std::size_t i = 0; i < image.size(); ++i) {
    const RgbPixel& p = rgb.data()[i];
    if (p[0] != p[1] || p[0] != p[2]) fail_kind(name, png.info(), "grey or indexed 8-bit PNG");
    image.data()[i] = p[0];
  }
  return image;
}

}  // namespace

ImageOf<std::uint8_t> decode_indexed(Bytes file, const std::string& name) {
  const ImageInfo info = decode_image_info(file, name);
  if (is_png(file) && info.channels >= 3 && info.bits == 8)
    return decode_equal_channels(file, name);
  if (!is_png(file) || info.channels != 1 || info.bits > 8) {
    fail_kind(name, info, "grey or indexed 8-bit PNG");
  }
  ImageOf<std::uint8_t> image(info.width, info.height);
  PngDecoder(file, name).decode(image.data());
  return image;
}

ImageInfo read_image_info(const fs::path& path) {
  return decode_image_info(read_bytes(path), path.string());
}
GrayImage read_gray(const fs::path& path, int bits) {
  return decode_gray(read_bytes(path), path.string(), bits);
}
RgbImage read_rgb(const fs::path& path) {
  return decode_rgb(read_bytes(path), path.string());
}
Image16 read_u16(const fs::path& path) {
  return decode_u16(read_bytes(path), path.string());
}
Rgb16Image read_rgb16(const fs::path& path) {
  return decode_rgb16(read_bytes(path), path.string());
}
ImageOf<std::uint8_t> read_indexed(const fs::path& path) {
  return decode_indexed(read_bytes(path), path.string());
}

void write_png(const fs::path& path, const GrayImage& image) {
  write_pixels(path, image, 1, 8);
}
void write_png(const fs::path& path, const RgbImage& image) {
  write_pixels(path, image, 3, 8);
}
void write_png(const fs::path& path, const Image16& image) {
  write_pixels(path, image, 1, 16);
}
void write_png(const fs::path& path, const Rgb16Image& image) {
  write_pixels(path, image, 3, 16);
}

}  // namespace kys_slam
