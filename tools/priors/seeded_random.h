// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace kys_slam {

/// A number in 0..1 that depends only on its arguments (splitmix64).
inline double seeded_uniform(std::uint64_t seed, std::uint64_t a, std::uint64_t b = 0) {
  std::uint64_t z = seed * 0x9E3779B97F4A7C15ull + a * 0xBF58476D1CE4E5B9ull +
                    b * 0x94D049BB133111EBull + 0x2545F4914F6CDD1Dull;
  for (int i = 0; i < 2; ++i) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    z ^= z >> 31;
  }
  return static_cast<double>(z >> 11) * 0x1.0p-53;
}

}  // namespace kys_slam
