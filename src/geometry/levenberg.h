// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>

#include "geometry/damping.h"

namespace kys_slam {

/// A step that a model has tried.
struct LevenbergStep {
  enum class Outcome : std::uint8_t {
    kTaken,    ///< the unknowns have moved
    kNone,     ///< the equations have no solution; nothing has moved
    kStopped,  ///< the same, as an interrupt came in between
  };
  /// Decrease of the cost that the linear model predicts; unknown where the model does not say.
  static constexpr double kUnknown = -1;

  Outcome outcome = Outcome::kNone;
  double predicted = kUnknown;
  bool last = false;  ///< too small for another one
};

struct LevenbergOptions {
  int iterations = 10;
  double tolerance = 1e-4;  ///< relative decrease of the cost that ends it
  /// Whether a refused step that changes the cost by less than that ends it as well.
  bool ends_when_flat = false;
  const std::atomic<bool>* stop = nullptr;
};

struct LevenbergSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;  ///< refused steps included
  bool stopped = false;
};

inline bool is_set(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// Levenberg-Marquardt (Madsen, Nielsen and Tingleff, "Methods for non-linear least squares
/// problems", 2004, Sec. 3.2). The model holds the unknowns:
///   double cost();                        at the present place
///   LevenbergStep step(double damping);   linearises, solves and moves
///   double cost_of_step();                where it has moved to
///   void accept();                        the place after the step is the present one
///   void restore();                       the place before the step is
/// \param damping rule with value(), accept(gain), refuse(), exhausted(): Damping for one
template <typename Model, typename DampingRule>
LevenbergSummary levenberg(Model& model, DampingRule damping, const LevenbergOptions& options) {
  using Outcome = LevenbergStep::Outcome;
  constexpr double kNegligible = 1e-3;  // of the tolerance
  LevenbergSummary summary;
  double cost = model.cost();
  summary.initial_cost = summary.final_cost = cost;
  while (summary.iterations < options.iterations && !damping.exhausted()) {
    summary.stopped = is_set(options.stop);
    if (summary.stopped) break;
    ++summary.iterations;
    const LevenbergStep step = model.step(damping.value());
    summary.stopped = step.outcome == Outcome::kStopped;
    if (summary.stopped) break;
    if (step.outcome == Outcome::kNone) {
      damping.refuse();
      continue;
    }
    const bool is_predicted = step.predicted >= 0;
    const double least = options.tolerance * cost;
    if (is_predicted && step.predicted <= kNegligible * least) break;
    const double candidate = model.cost_of_step();
    const double decrease = cost - candidate;
    const double gain = is_predicted ? decrease / step.predicted : decrease >= 0 ? 1 : -1;
    if (gain > Damping::kMinGain) {
      model.accept();
      cost = candidate;
      damping.accept(gain);
      if (step.last || decrease <= least) break;
    } else {
      model.restore();
      if (step.last || (options.ends_when_flat && std::abs(decrease) <= least)) break;
      damping.refuse();
    }
  }
  summary.final_cost = cost;
  return summary;
}

}  // namespace kys_slam
