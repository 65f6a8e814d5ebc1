// SPDX-License-Identifier: BSD-3-Clause
#define KYS_KERNELS_NAME kAvx512
#define KYS_KERNELS_LABEL "avx512"
#include "matching/patch_kernels.inc"
