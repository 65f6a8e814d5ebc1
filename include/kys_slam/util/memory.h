// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace kys_slam {

/// Reserved address space. Release it when memory has run out, to save results. It takes no
/// physical memory.
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

/// For programs that allocate and free images of the same sizes for every frame: the allocator
/// keeps freed memory and does not map and clear new pages every time. Call it once, at the start
/// of main(). \param below bytes; larger blocks return to the system when they are freed
inline void keep_freed_memory([[maybe_unused]] int below = 32 << 20) {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, below);
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

/// Returns freed memory to the system. Call it after rare work on much memory; the allocator does
/// not do it for blocks inside its heaps.
inline void return_freed_memory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

}  // namespace kys_slam
