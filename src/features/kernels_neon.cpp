// SPDX-License-Identifier: BSD-3-Clause
#define KYS_NEON
#define KYS_KERNELS_NAME kNeon
#define KYS_KERNELS_LABEL "neon"
#include "features/kernels.inc"
