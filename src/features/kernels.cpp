#include "features/kernels.h"

#include <array>

namespace kys_slam::kernels {

extern const Kernels kPlain;
#ifdef KYS_X86_KERNELS
extern const Kernels kAvx2;
extern const Kernels kAvx512;
#endif

namespace {

struct Available {
  std::array<const Kernels*, 3> list{};
  std::size_t count = 0;

  Available() {
    list[count++] = &kPlain;
#ifdef KYS_X86_KERNELS
    if (__builtin_cpu_supports("avx2")) list[count++] = &kAvx2;
    if (__builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512dq")) {
      list[count++] = &kAvx512;
    }
#endif
  }
};

}  // namespace

std::span<const Kernels* const> available_kernels() {
  static const Available available;
  return {available.list.data(), available.count};
}

const Kernels& kernels() {
  return *available_kernels().back();
}

}  // namespace kys_slam::kernels
