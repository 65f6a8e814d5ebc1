#pragma once

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace kys_slam {

/// For programs that make and drop images of the same sizes for every frame: the allocator keeps
/// what it has, where it would map, clear and unmap every image anew. Once, at the start of main().
inline void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // bytes
  mallopt(M_TRIM_THRESHOLD, 512 << 20);
#endif
}

}  // namespace kys_slam
