#pragma once

#include <kys/option_list.h>

#include <algorithm>
#include <cmath>

namespace kys_slam {

struct BeliefUpdateOptions {
  double change_rate = 0.2;  ///< 1/s, at which things change between standing and moving
  double max_evidence = 3;   ///< nats, what one frame may say at most
  double max_log_odds = 7;   ///< nats, belief never gets surer than this
};
/// For check_options().
void describe(kys::OptionList& list, BeliefUpdateOptions& options);

inline double probability(double log_odds) {
  return 1.0 / (1.0 + std::exp(-log_odds));
}
inline double log_odds(double probability) {
  return std::log(probability / (1.0 - probability));
}

/// Log-odds of standing still `dt` seconds later, by a chain of two states that changes at
/// `change_rate` and would settle at `settled` (log-odds): p' = p (1 - q) + (1 - p) q',
/// q = s (1 - p_settled), q' = s p_settled, s = 1 - exp(-change_rate dt).
inline double after_time(double present, double settled, double dt,
                         const BeliefUpdateOptions& options) {
  const double share = 1.0 - std::exp(-options.change_rate * std::max(dt, 0.0));
  const double p = probability(present);
  const double moved = p + share * (probability(settled) - p);
  return std::clamp(log_odds(std::clamp(moved, 1e-12, 1.0 - 1e-12)), -options.max_log_odds,
                    options.max_log_odds);
}

/// Log-odds after the evidence of one frame (a log-likelihood ratio, nats).
inline double after_evidence(double present, double log_ratio, const BeliefUpdateOptions& options) {
  const double said = std::clamp(log_ratio, -options.max_evidence, options.max_evidence);
  return std::clamp(present + said, -options.max_log_odds, options.max_log_odds);
}

}  // namespace kys_slam
