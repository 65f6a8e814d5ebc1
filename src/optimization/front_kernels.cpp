// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/front_kernels.h"

#include "util/kernel_variants.h"

namespace kys_slam::front {

#include "util/kernel_list.inc"

}  // namespace kys_slam::front
