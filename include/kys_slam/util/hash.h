#pragma once

#include <cstdint>

namespace kys_slam {

/// Mixes 64 bits (SplitMix64 finaliser): the same everywhere, unlike <random>'s distributions.
inline std::uint64_t mix(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

/// Hash of a few integers, for values that must not depend on the order they are asked in.
inline std::uint64_t hash_of(std::uint64_t a, std::uint64_t b = 0, std::uint64_t c = 0,
                             std::uint64_t d = 0) {
  return mix(mix(mix(mix(a) ^ b) ^ c) ^ d);
}

}  // namespace kys_slam
