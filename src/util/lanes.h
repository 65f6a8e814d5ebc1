// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstring>

namespace kys_slam {

/// Four doubles, or eight floats, in one vector. GCC and Clang compile them to the vector
/// instructions of the target. Every lane is rounded alike with any of these, so results do not
/// depend on the machine.
// The alignment is stated since compilers take a smaller one where the target has no such vectors,
// while the clones below rely on it.
using Lanes = double __attribute__((vector_size(32), aligned(32)));
using LaneMask = long long __attribute__((vector_size(32), aligned(32)));
static_assert(alignof(Lanes) == 32);
inline constexpr int kLanes = 4;
using FloatLanes = float __attribute__((vector_size(32), aligned(32)));
inline constexpr int kFloatLanes = 8;

// A function with this mark (it uses lanes, or loops over image rows) is compiled for three
// instruction sets, and the loader takes the best one. Functions it calls are compiled for it only
// when they are inlined, and must not return lanes by value (Clang refuses that between instruction
// sets, inlined or not). Not with sanitizers, which start after the loader has chosen.
#ifdef __has_feature
#define KYS_HAS_FEATURE(feature) __has_feature(feature)
#else
#define KYS_HAS_FEATURE(feature) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || \
    KYS_HAS_FEATURE(address_sanitizer) || KYS_HAS_FEATURE(thread_sanitizer)
#define KYS_SANITIZED
#endif
#if defined(__x86_64__) && defined(__linux__) && __has_attribute(target_clones) && \
    !defined(KYS_SANITIZED) && !defined(__AVX2__)
#define KYS_VECTOR_CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define KYS_VECTOR_CLONES
#endif

// Before a loop whose iterations do not touch what others write. Compilers test a few arrays for
// overlap themselves, not many.
#ifdef __clang__
#define KYS_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define KYS_INDEPENDENT _Pragma("GCC ivdep")
#endif

#define KYS_ALWAYS_INLINE inline __attribute__((always_inline))

KYS_ALWAYS_INLINE Lanes broadcast(double x) {
  return Lanes{x, x, x, x};
}
/// Unaligned load and store.
KYS_ALWAYS_INLINE FloatLanes load_lanes(const float* from) {
  FloatLanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}
KYS_ALWAYS_INLINE void store_lanes(const FloatLanes& lanes, float* to) {
  std::memcpy(to, &lanes, sizeof lanes);
}
/// Sum over the lanes, always in the same order.
KYS_ALWAYS_INLINE double lane_sum(const Lanes& x) {
  return (x[0] + x[1]) + (x[2] + x[3]);
}
KYS_ALWAYS_INLINE float lane_sum(const FloatLanes& x) {
  return ((x[0] + x[1]) + (x[2] + x[3])) + ((x[4] + x[5]) + (x[6] + x[7]));
}
KYS_ALWAYS_INLINE bool any(const LaneMask& m) {
  return ((m[0] | m[1]) | (m[2] | m[3])) != 0;
}
KYS_ALWAYS_INLINE Lanes sqrt_lanes(const Lanes& x) {
  return Lanes{__builtin_sqrt(x[0]), __builtin_sqrt(x[1]), __builtin_sqrt(x[2]),
               __builtin_sqrt(x[3])};
}

}  // namespace kys_slam
