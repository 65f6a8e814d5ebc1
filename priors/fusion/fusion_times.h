// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace kys_slam {

/// Time of the stages for one camera, ms.
struct FusionTimes {
  double fit = 0, residual = 0, drift = 0, statistics = 0, decide_export = 0;

  [[nodiscard]] double total() const { return fit + residual + drift + statistics + decide_export; }
  FusionTimes& operator+=(const FusionTimes& other) {
    fit += other.fit;
    residual += other.residual;
    drift += other.drift;
    statistics += other.statistics;
    decide_export += other.decide_export;
    return *this;
  }
};

}  // namespace kys_slam
