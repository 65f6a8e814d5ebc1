#pragma once

#include <cstddef>

namespace kys_slam {

/// Address space set aside, so that something is left to save results with when memory has run out.
/// It is not touched and takes no memory before.
class MemoryReserve {
 public:
  explicit MemoryReserve(std::size_t bytes = std::size_t{32} << 20);
  MemoryReserve(const MemoryReserve&) = delete;
  MemoryReserve& operator=(const MemoryReserve&) = delete;
  ~MemoryReserve() { release(); }

  void release() noexcept;

 private:
  void* begin_ = nullptr;
  std::size_t bytes_ = 0;
};

}  // namespace kys_slam
