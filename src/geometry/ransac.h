// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/portable_math.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>

namespace kys_slam {

/// Draws samples of distinct indices; the same seed gives the same samples on every machine.
template <std::size_t Size>
class SampleGenerator {
 public:
  /// `count` must be at least Size.
  SampleGenerator(std::size_t count, std::uint64_t seed) : count_(count), engine_(seed) {}

  std::array<std::size_t, Size> next() {
    std::array<std::size_t, Size> sample{};
    for (std::size_t i = 0; i < Size; ++i) {
      bool taken = true;
      while (taken) {
        sample[i] = static_cast<std::size_t>(engine_() % count_);
        taken = false;
        for (std::size_t k = 0; k < i; ++k) taken |= sample[k] == sample[i];
      }
    }
    return sample;
  }

 private:
  std::size_t count_;
  std::mt19937_64 engine_;
};

/// Number of samples of `size` that contain one without outliers with probability `confidence`,
/// when `inliers` of `count` are inliers (Fischler and Bolles 1981); at most `limit`.
inline int ransac_iterations(std::size_t inliers, std::size_t count, int size, double confidence,
                             int limit) {
  if (count == 0 || inliers == 0) return limit;
  const double good =
      kys::portable::pow(static_cast<double>(inliers) / static_cast<double>(count), size);
  if (good >= 1.0) return 1;
  const double needed = kys::portable::log(1.0 - confidence) / kys::portable::log1p(-good);
  return needed < limit ? static_cast<int>(std::ceil(needed)) : limit;
}

}  // namespace kys_slam
