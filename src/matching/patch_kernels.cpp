// SPDX-License-Identifier: BSD-3-Clause
#include "matching/patch_kernels.h"

#include "util/kernel_variants.h"

namespace kys_slam::patch {

#include "util/kernel_list.inc"

}  // namespace kys_slam::patch
