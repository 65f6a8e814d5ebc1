// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>
#include <kys/option_list.h>
#include <kys/portable_math.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {

struct BeliefUpdateOptions {
  double change_rate = 0.2;  ///< 1/s, rate of changes between static and moving
  double max_evidence = 3;   ///< nats, limit of the evidence of one frame
  double max_log_odds = 7;   ///< nats, limit of the absolute log-odds
};
/// For check_options().
void describe(kys::OptionList& list, BeliefUpdateOptions& options);

/// Whether a prior is of an instance that can move.
inline bool has_belief(const kys::Prior& prior, const kys::InitialBelief& start) {
  return start.mobility(prior.label) != kys::Mobility::kFixed && prior.instance >= 0;
}

inline double probability(double log_odds) {
  return 1.0 / (1.0 + kys::portable::exp(-log_odds));
}
inline double log_odds(double probability) {
  return kys::portable::log(probability / (1.0 - probability));
}

/// Log-odds of being static `dt` seconds later, by a two-state Markov chain with rate `change_rate`
/// and the steady state `steady` (log-odds): p' = p (1 - q) + (1 - p) q', q = s (1 - p_steady), q'
/// = s p_steady, s = 1 - exp(-change_rate dt).
inline double after_time(double present, double steady, double dt,
                         const BeliefUpdateOptions& options) {
  const double share = 1.0 - kys::portable::exp(-options.change_rate * std::max(dt, 0.0));
  const double p = probability(present);
  const double moved = p + share * (probability(steady) - p);
  return std::clamp(log_odds(std::clamp(moved, 1e-12, 1.0 - 1e-12)), -options.max_log_odds,
                    options.max_log_odds);
}

/// Log-odds after the evidence of one frame (log-likelihood ratio, nats).
inline double after_evidence(double present, double log_ratio, const BeliefUpdateOptions& options) {
  const double said = std::clamp(log_ratio, -options.max_evidence, options.max_evidence);
  return std::clamp(present + said, -options.max_log_odds, options.max_log_odds);
}

}  // namespace kys_slam
