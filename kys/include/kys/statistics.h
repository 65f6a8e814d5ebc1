// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>

#include <array>
#include <cstddef>
#include <cstdint>

namespace kys {

/// Counters of compared pairs, owned by the caller: one object per thread and frame, summed with
/// +=. Every pair given to the model is counted exactly once, under the tier of its Distance.
///
/// With a bound (evaluate() with one, best_two() always) a pair that cannot be the best is counted
/// as skipped before its priors are read, so its tier is not known. The counters of tiers, gated,
/// filtered and bypassed pairs cover the other pairs.
struct Statistics {
  std::array<std::uint64_t, kTierCount> pairs{};     ///< compared, by Tier
  std::array<std::uint64_t, kTierCount> accepted{};  ///< accepted as matches by the caller, by Tier

  void count(Tier tier) { ++pairs[static_cast<std::size_t>(tier)]; }
  /// Called by the caller: this pair passed its thresholds and became a match.
  void accept(Tier tier) { ++accepted[static_cast<std::size_t>(tier)]; }

  [[nodiscard]] std::uint64_t evaluated(Tier tier) const {
    return pairs[static_cast<std::size_t>(tier)];
  }
  [[nodiscard]] std::uint64_t accepted_of(Tier tier) const {
    return accepted[static_cast<std::size_t>(tier)];
  }
  [[nodiscard]] std::uint64_t gated() const { return evaluated(Tier::kGated); }
  [[nodiscard]] std::uint64_t filtered() const { return evaluated(Tier::kFiltered); }
  [[nodiscard]] std::uint64_t bypassed() const { return evaluated(Tier::kBypassed); }
  [[nodiscard]] std::uint64_t skipped() const { return evaluated(Tier::kSkipped); }
  [[nodiscard]] std::uint64_t total() const {
    std::uint64_t sum = 0;
    for (const std::uint64_t n : pairs) {
      sum += n;
    }
    return sum;
  }

  Statistics& operator+=(const Statistics& other) {
    for (std::size_t i = 0; i < kTierCount; ++i) {
      pairs[i] += other.pairs[i];
      accepted[i] += other.accepted[i];
    }
    return *this;
  }

  friend bool operator==(const Statistics&, const Statistics&) = default;
};

}  // namespace kys
