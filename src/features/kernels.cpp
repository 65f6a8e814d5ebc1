#include "features/kernels.h"

#include "util/kernel_variants.h"

namespace kys_slam::kernels {

extern const Kernels kPlain;
#ifdef KYS_X86_KERNELS
extern const Kernels kAvx2;
extern const Kernels kAvx512;
#endif

std::span<const Kernels* const> available_kernels() {
#ifdef KYS_X86_KERNELS
  static const KernelVariants<Kernels> variants(kPlain, kAvx2, kAvx512);
#else
  static const KernelVariants<Kernels> variants(kPlain);
#endif
  return variants.list();
}

const Kernels& kernels() {
  return *available_kernels().back();
}

}  // namespace kys_slam::kernels
