// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

namespace kys_slam {

/// A rectangular array of pixels that owns its memory. Row-major, rows are contiguous (stride
/// equals width). Pixel (0,0) is the top left one; integer coordinates are pixel centres.
template <typename T>
class ImageOf {
 public:
  ImageOf() = default;
  ImageOf(int width, int height, T fill = T{}) : ImageOf(for_overwrite(width, height)) {
    std::fill_n(data(), size(), fill);
  }
  /// An image with uninitialised pixels: write a pixel before you read it.
  static ImageOf for_overwrite(int width, int height) {
    ImageOf image;
    image.width_ = width;
    image.height_ = height;
    image.data_ = std::make_unique_for_overwrite<T[]>(image.size());
    return image;
  }
  ImageOf(const ImageOf& other) : ImageOf(for_overwrite(other.width_, other.height_)) {
    std::copy_n(other.data(), size(), data());
  }
  ImageOf(ImageOf&& other) noexcept { swap(other); }
  ImageOf& operator=(const ImageOf& other) {
    if (width_ != other.width_ || height_ != other.height_) return *this = ImageOf(other);
    std::copy_n(other.data(), size(), data());
    return *this;
  }
  ImageOf& operator=(ImageOf&& other) noexcept {
    swap(other);
    return *this;
  }
  ~ImageOf() = default;

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool empty() const { return size() == 0; }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }

  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] const T* data() const { return data_.get(); }
  [[nodiscard]] T* row(int y) { return data() + static_cast<std::size_t>(y) * width_; }
  [[nodiscard]] const T* row(int y) const { return data() + static_cast<std::size_t>(y) * width_; }
  [[nodiscard]] T& at(int x, int y) { return row(y)[x]; }
  [[nodiscard]] const T& at(int x, int y) const { return row(y)[x]; }

  [[nodiscard]] bool contains(int x, int y) const {
    return x >= 0 && y >= 0 && x < width_ && y < height_;
  }

  friend bool operator==(const ImageOf& a, const ImageOf& b) {
    return a.width_ == b.width_ && a.height_ == b.height_ &&
           std::equal(a.data(), a.data() + a.size(), b.data());
  }

 private:
  void swap(ImageOf& other) noexcept {
    std::swap(width_, other.width_);
    std::swap(height_, other.height_);
    std::swap(data_, other.data_);
  }

  int width_ = 0;
  int height_ = 0;
  std::unique_ptr<T[]> data_;
};

using GrayImage = ImageOf<std::uint8_t>;

}  // namespace kys_slam
