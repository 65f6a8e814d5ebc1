#pragma once

#include <cstddef>

#ifdef __GLIBC__
#include <malloc.h>
#endif

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

/// For programs that make and drop images of the same sizes for every frame: the allocator keeps
/// what it has, where it would map, clear and unmap every image anew. Once, at the start of main().
/// \param below bytes; larger blocks go back to the system when they are freed
inline void keep_freed_memory([[maybe_unused]] int below = 32 << 20) {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, below);
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

/// After work on much memory that comes back rarely: what was freed of it goes to the system, which
/// the allocator does not do for blocks inside its heaps.
inline void return_freed_memory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

}  // namespace kys_slam
