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

// A function marked so (it has lanes in it, or loops over image rows) exists for three kinds of
// machines, and the loader takes the best one. What it calls is compiled so only when inlined.
// Sanitizers do not start up before the loader chooses, hence not with them.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__AVX2__)
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
