// SPDX-License-Identifier: BSD-3-Clause
#define KYS_KERNELS_NAME kAvx2
#define KYS_KERNELS_LABEL "avx2"
#include "matching/patch_kernels.inc"
