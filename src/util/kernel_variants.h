// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <span>

namespace kys_slam {

/// The variants of a kernel, compiled once per instruction set, that this machine can run; the
/// portable one first.
template <typename Kernels>
class KernelVariants {
 public:
  explicit KernelVariants(const Kernels& plain) { list_[count_++] = &plain; }
  /// One that every machine of this architecture can run.
  KernelVariants(const Kernels& plain, const Kernels& better) : KernelVariants(plain) {
    list_[count_++] = &better;
  }
#ifdef KYS_X86_KERNELS
  KernelVariants(const Kernels& plain, const Kernels& avx2, const Kernels& avx512)
      : KernelVariants(plain) {
    if (__builtin_cpu_supports("avx2")) list_[count_++] = &avx2;
    if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512dq")) {
      list_[count_++] = &avx512;
    }
  }
#endif
  [[nodiscard]] std::span<const Kernels* const> list() const {
    return {list_.data(), count_};
  }

 private:
  std::array<const Kernels*, 3> list_{};
  std::size_t count_ = 0;
};

}  // namespace kys_slam
