#pragma once

#include <cstdint>

namespace kys_slam::simulator {

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

/// A small deterministic generator.
class Rng {
 public:
  explicit Rng(std::uint64_t seed) : state_(mix(seed)) {}

  std::uint64_t bits() {
    state_ += 0x9e3779b97f4a7c15ULL;
    return mix(state_);
  }
  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Uniform integer in [0, n).
  int below(int n) { return static_cast<int>(bits() % static_cast<std::uint64_t>(n)); }
  bool chance(double p) { return uniform() < p; }
  /// Standard normal deviate.
  double gaussian();

 private:
  std::uint64_t state_;
};

/// Inverse of the standard normal distribution function, |error| < 1.2e-9 (Acklam).
double inverse_normal(double p);

}  // namespace kys_slam::simulator
