// SPDX-License-Identifier: BSD-3-Clause
#include "io/jpeg_codec.h"

#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>
#include <turbojpeg.h>

#include <memory>
#include <new>

namespace kys_slam {
namespace {

struct HandleDelete {
  void operator()(void* handle) const { tjDestroy(handle); }
};

using Handle = std::unique_ptr<void, HandleDelete>;

Handle checked(tjhandle handle) {
  if (handle == nullptr) throw std::bad_alloc();
  return Handle(handle);
}

[[noreturn]] void fail(const Handle& handle, const std::string& name) {
  throw InputError(name + ": corrupt JPEG (" + tjGetErrorStr2(handle.get()) + ")");
}

void decode(std::span<const std::uint8_t> file, const std::string& name, const ImageInfo& info,
            int format, std::uint8_t* out) {
  const Handle handle = checked(tjInitDecompress());
  if (tjDecompress2(handle.get(), file.data(), file.size(), out, info.width, 0, info.height, format,
                    TJFLAG_LIMITSCANS) != 0) {
    fail(handle, name);
  }
}

}  // namespace

bool is_jpeg(std::span<const std::uint8_t> file) {
  return file.size() >= 3 && file[0] == 0xff && file[1] == 0xd8 && file[2] == 0xff;
}

ImageInfo jpeg_info(std::span<const std::uint8_t> file, const std::string& name) {
  const Handle handle = checked(tjInitDecompress());
  int width = 0, height = 0, subsampling = 0, colorspace = 0;
  if (tjDecompressHeader3(handle.get(), file.data(), file.size(), &width, &height, &subsampling,
                          &colorspace) != 0) {
    fail(handle, name);
  }
  if (width <= 0 || height <= 0 || width > kMaxImageSide || height > kMaxImageSide) {
    throw InputError(name + ": image size " + std::to_string(width) + "x" + std::to_string(height) +
                     " is outside 1.." + std::to_string(kMaxImageSide));
  }
  // Every block of 64 pixels takes some bits: a small file does not make a large image.
  constexpr std::size_t kMostPixelsPerByte = std::size_t{1} << 14;
  if (static_cast<std::size_t>(width) * static_cast<std::size_t>(height) >
      kMostPixelsPerByte * file.size()) {
    throw InputError(name + ": truncated JPEG");
  }
  const std::size_t channels = colorspace == TJCS_GRAY ? 1 : 3;
  // A progressive one also keeps all its coefficients.
  check_memory(name, 3 * channels * static_cast<std::size_t>(width) * height);
  if (colorspace == TJCS_CMYK || colorspace == TJCS_YCCK) {
    throw InputError(name + ": CMYK JPEG; grey or colour is needed");
  }
  return {width, height, colorspace == TJCS_GRAY ? 1 : 3, 8, false, true};
}

GrayImage decode_jpeg_gray(std::span<const std::uint8_t> file, const std::string& name) {
  const ImageInfo info = jpeg_info(file, name);
  GrayImage image(info.width, info.height);
  decode(file, name, info, TJPF_GRAY, image.data());
  return image;
}

std::vector<std::uint8_t> encode_jpeg(const GrayImage& image, int quality) {
  if (image.empty()) throw InputError("an empty image cannot be written as JPEG");
  const Handle handle = checked(tjInitCompress());
  thread_local std::vector<std::uint8_t> buffer;  // of the largest size: memory that stays mapped
  buffer.resize(tjBufSize(image.width(), image.height(), TJSAMP_GRAY));
  std::uint8_t* out = buffer.data();
  unsigned long size = buffer.size();
  if (tjCompress2(handle.get(), image.data(), image.width(), 0, image.height(), TJPF_GRAY, &out,
                  &size, TJSAMP_GRAY, quality, TJFLAG_NOREALLOC) != 0) {
    throw InputError(std::string("JPEG: ") + tjGetErrorStr2(handle.get()));
  }
  return {out, out + size};
}

RgbImage decode_jpeg_rgb(std::span<const std::uint8_t> file, const std::string& name) {
  const ImageInfo info = jpeg_info(file, name);
  RgbImage image(info.width, info.height);
  decode(file, name, info, TJPF_RGB, image.data()->data());
  return image;
}

}  // namespace kys_slam
