// SPDX-License-Identifier: BSD-3-Clause
#define KYS_KERNELS_NAME kPlain
#define KYS_KERNELS_LABEL "plain"
#include "optimization/front_kernels.inc"
