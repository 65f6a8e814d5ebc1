#define KYS_KERNELS_NAME kAvx512
#define KYS_KERNELS_LABEL "avx512"
#include "optimization/front_kernels.inc"
