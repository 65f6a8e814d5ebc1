// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// Included before everything else in what uses Eigen on ARM64 (KysTargets.cmake). Eigen's code for
// NEON fuses multiplications with additions and adds in another order than its code for SSE2, which
// x86-64 has: results differ in the last bits. So Eigen takes its code for SSE2 here too, on the
// same instructions of NEON by way of SIMDe, and results are the same bytes.
#if defined(__aarch64__) && defined(__cplusplus)

#define SIMDE_ENABLE_NATIVE_ALIASES
#include <simde/x86/sse2.h>

// Eigen's own choice of instructions is left out, its result stated.
#define EIGEN_DONT_VECTORIZE
#define EIGEN_VECTORIZE
#define EIGEN_VECTORIZE_SSE
#define EIGEN_VECTORIZE_SSE2
#define EIGEN_MAX_ALIGN_BYTES 16
#define EIGEN_MAX_STATIC_ALIGN_BYTES 16
// Sums over more than a few hundred terms are split by it; on x86-64 it is that of the processor.
#define EIGEN_DEFAULT_L1_CACHE_SIZE 32768

// Eigen calls GCC's name of one instruction.
#define __builtin_ia32_sqrtsd(x) _mm_sqrt_sd(x, x)

// SIMDe has macros for shifts, to which Eigen gives its own types.
#undef _mm_slli_epi16
#undef _mm_slli_epi32
#undef _mm_slli_epi64
#undef _mm_srli_epi16
#undef _mm_srli_epi32
#undef _mm_srli_epi64
#undef _mm_srai_epi32
#define _mm_slli_epi16(a, n) simde_mm_slli_epi16(simde__m128i(a), n)
#define _mm_slli_epi32(a, n) simde_mm_slli_epi32(simde__m128i(a), n)
#define _mm_slli_epi64(a, n) simde_mm_slli_epi64(simde__m128i(a), n)
#define _mm_srli_epi16(a, n) simde_mm_srli_epi16(simde__m128i(a), n)
#define _mm_srli_epi32(a, n) simde_mm_srli_epi32(simde__m128i(a), n)
#define _mm_srli_epi64(a, n) simde_mm_srli_epi64(simde__m128i(a), n)
#define _mm_srai_epi32(a, n) simde_mm_srai_epi32(simde__m128i(a), n)

#endif
