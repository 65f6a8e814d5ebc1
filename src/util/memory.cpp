// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/memory.h>
#include <sys/mman.h>

namespace kys_slam {

MemoryReserve::MemoryReserve(std::size_t bytes) : bytes_(bytes) {
  begin_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (begin_ == MAP_FAILED) begin_ = nullptr;
}

void MemoryReserve::release() noexcept {
  if (begin_ != nullptr) ::munmap(begin_, bytes_);
  begin_ = nullptr;
}

}  // namespace kys_slam
