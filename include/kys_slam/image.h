#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace kys_slam {

/// Elements made without a value have none, where std::allocator clears them.
template <typename T>
struct UnclearedAllocator : std::allocator<T> {
  template <typename U>
  struct rebind {
    using other = UnclearedAllocator<U>;
  };
  template <typename U>
  void construct(U* at) {
    ::new (static_cast<void*>(at)) U;
  }
  template <typename U, typename... Arguments>
  void construct(U* at, Arguments&&... arguments) {
    std::construct_at(at, std::forward<Arguments>(arguments)...);
  }
};

/// A rectangular array of pixels that owns its memory. Row-major, rows are contiguous (stride
/// equals width). Pixel (0,0) is the top left one; integer coordinates are pixel centres.
template <typename T>
class ImageOf {
 public:
  ImageOf() = default;
  ImageOf(int width, int height, T fill = T{})
      : width_(width), height_(height), data_(area(width, height), fill) {}
  /// An image whose pixels have no values yet: all that are read must be written first.
  static ImageOf for_overwrite(int width, int height) {
    ImageOf image;
    image.width_ = width;
    image.height_ = height;
    image.data_.resize(area(width, height));
    return image;
  }

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool empty() const { return data_.empty(); }
  [[nodiscard]] std::size_t size() const { return data_.size(); }

  [[nodiscard]] T* data() { return data_.data(); }
  [[nodiscard]] const T* data() const { return data_.data(); }
  [[nodiscard]] T* row(int y) { return data_.data() + static_cast<std::size_t>(y) * width_; }
  [[nodiscard]] const T* row(int y) const {
    return data_.data() + static_cast<std::size_t>(y) * width_;
  }
  [[nodiscard]] T& at(int x, int y) { return row(y)[x]; }
  [[nodiscard]] const T& at(int x, int y) const { return row(y)[x]; }

  [[nodiscard]] bool contains(int x, int y) const {
    return x >= 0 && y >= 0 && x < width_ && y < height_;
  }

  friend bool operator==(const ImageOf&, const ImageOf&) = default;

 private:
  static std::size_t area(int width, int height) {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }

  int width_ = 0;
  int height_ = 0;
  std::vector<T, UnclearedAllocator<T>> data_;
};

using GrayImage = ImageOf<std::uint8_t>;

}  // namespace kys_slam
