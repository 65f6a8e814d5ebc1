// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/evaluation.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace kys_slam {

Statistics statistics(std::span<const double> errors) {
  Statistics s;
  s.count = errors.size();
  if (errors.empty()) return s;
  std::vector<double> sorted(errors.begin(), errors.end());
  std::sort(sorted.begin(), sorted.end());
  const auto n = static_cast<double>(sorted.size());
  double sum = 0, sum_sq = 0;
  for (const double e : sorted) {
    sum += e;
    sum_sq += e * e;
  }
  s.mean = sum / n;
  s.rmse = std::sqrt(sum_sq / n);
  double variance = 0;
  for (const double e : sorted) variance += (e - s.mean) * (e - s.mean) / n;
  s.std = std::sqrt(variance);
  const std::size_t half = sorted.size() / 2;
  s.median = sorted.size() % 2 == 1 ? sorted[half] : 0.5 * (sorted[half - 1] + sorted[half]);
  s.min = sorted.front();
  s.max = sorted.back();
  return s;
}

}  // namespace kys_slam
