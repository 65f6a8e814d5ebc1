// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>

namespace kys_slam {

/// A large array whose memory can be released in parts. An element is undefined until it is
/// written, first or after its release. On Linux released pages return to the system at once.
template <typename T>
class PageArray {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  PageArray() = default;
  /// \throws std::bad_alloc
  explicit PageArray(std::size_t size) : size_(size) {
    if (size == 0) return;
    void* begin = ::mmap(nullptr, size * sizeof(T), PROT_READ | PROT_WRITE,
                         MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (begin == MAP_FAILED) throw std::bad_alloc();
    data_ = {static_cast<T*>(begin), Unmap{size * sizeof(T)}};
  }

  [[nodiscard]] T* data() { return data_.get(); }
  [[nodiscard]] const T* data() const { return data_.get(); }
  [[nodiscard]] std::size_t size() const { return size_; }

  /// Elements [begin, end) are not needed any more. Pages that hold others as well stay.
  void release([[maybe_unused]] std::size_t begin, [[maybe_unused]] std::size_t end) {
#ifdef __linux__
    if (data_ == nullptr) return;
    const std::size_t first = (begin * sizeof(T) + kPage - 1) / kPage * kPage;
    // The system rounds the end of the array up to its pages, which are the array's own.
    const std::size_t bytes = end * sizeof(T);
    const std::size_t last = end == size_ ? bytes : bytes / kPage * kPage;
    if (last <= first) return;
    ::madvise(reinterpret_cast<std::byte*>(data_.get()) + first, last - first, MADV_DONTNEED);
#endif
  }

 private:
  static constexpr std::size_t kPage = std::size_t{1} << 16;  // a multiple of every system's
  struct Unmap {
    std::size_t bytes = 0;
    void operator()(T* begin) const { ::munmap(static_cast<void*>(begin), bytes); }
  };
  std::unique_ptr<T, Unmap> data_;
  std::size_t size_ = 0;
};

}  // namespace kys_slam
