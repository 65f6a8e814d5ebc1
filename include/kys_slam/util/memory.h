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
inline void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // bytes
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

}  // namespace kys_slam
