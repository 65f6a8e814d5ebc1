// SPDX-License-Identifier: BSD-3-Clause
#include "features/kernels.h"

#include "util/kernel_variants.h"

namespace kys_slam::kernels {

#include "util/kernel_list.inc"

}  // namespace kys_slam::kernels
