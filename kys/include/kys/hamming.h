// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

// Portable x86-64 code may not assume the popcnt instruction, and a call per descriptor pair costs
// as much as the comparison itself. So the instruction is emitted in place, behind one predictable
// branch on a flag that is set when the program starts. Everywhere else (ARM64, -march=native)
// std::popcount already is the best code.
#if defined(__x86_64__) && !defined(__POPCNT__) && defined(__GNUC__)
#define KYS_POPCNT_AT_RUN_TIME 1
#else
#define KYS_POPCNT_AT_RUN_TIME 0
#endif

namespace kys {

namespace detail {

inline int popcount_portable(const Descriptor& a, const Descriptor& b) {
  return std::popcount(a.words[0] ^ b.words[0]) + std::popcount(a.words[1] ^ b.words[1]) +
         std::popcount(a.words[2] ^ b.words[2]) + std::popcount(a.words[3] ^ b.words[3]);
}

#if KYS_POPCNT_AT_RUN_TIME
/// False until the start-up code of the library has run. Comparisons before that are correct and
/// slower.
extern const bool has_popcnt;

inline std::uint64_t popcnt(std::uint64_t word) {
  __asm__("popcntq %0, %0" : "+r"(word) : : "cc");
  return word;
}

inline int popcount_instruction(const Descriptor& a, const Descriptor& b) {
  return static_cast<int>(popcnt(a.words[0] ^ b.words[0]) + popcnt(a.words[1] ^ b.words[1]) +
                          popcnt(a.words[2] ^ b.words[2]) + popcnt(a.words[3] ^ b.words[3]));
}
#endif

}  // namespace detail

/// Number of bits in which two descriptors differ, 0..256.
inline int hamming(const Descriptor& a, const Descriptor& b) {
#if KYS_POPCNT_AT_RUN_TIME
  if (detail::has_popcnt) [[likely]] {
    return detail::popcount_instruction(a, b);
  }
#endif
  return detail::popcount_portable(a, b);
}

/// hamming() of one descriptor and many: distances[i] is the distance to
/// descriptors[candidates[i]], bits. With AVX2 or AVX-512 (chosen at run time) two to four times as
/// fast as single calls. `distances` must be at least as long as `candidates`. Indices are not
/// checked.
void hamming_many(const Descriptor& query, std::span<const Descriptor> descriptors,
                  std::span<const std::uint32_t> candidates, std::span<std::int16_t> distances);

namespace detail {

/// One implementation of hamming_many() that this machine can run.
struct HammingKernel {
  std::string_view name;
  void (*run)(const Descriptor& query, const Descriptor* descriptors,
              const std::uint32_t* candidates, std::size_t count, std::int16_t* distances);
};

/// All of them, the fastest last. For tests and benchmarks.
std::vector<HammingKernel> hamming_kernels();

}  // namespace detail

}  // namespace kys
