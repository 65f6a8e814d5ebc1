// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys/label_space.h>
#include <kys/option_list.h>

#include <cstdint>
#include <string_view>
#include <vector>

namespace kys {

/// Whether objects of a class can move by themselves.
enum class Mobility : std::uint8_t {
  kFixed,    ///< stuff, and labels that are not valid
  kCarried,  ///< objects that move only when somebody moves them: chairs, bags
  kMobile,   ///< people, animals, vehicles
};

/// The mobility of a class, by its name and thing flag ("car", "Van", "person", ...).
Mobility mobility(const LabelClass& label_class);

/// Initial log-odds ln(p / (1 - p)), nats, that an instance of a prior file is static: the value of
/// its class, plus the value of the file's motion flag when the file judges motion.
struct BeliefOptions {
  double carried = 3;      ///< nats, class of mobility kCarried
  double mobile = 0.5;     ///< nats, class of mobility kMobile
  double flagged = -1.5;   ///< nats, added when the file flags the instance as moving
  double unflagged = 0.5;  ///< nats, added when the file does not flag it as moving

  /// Throws Error naming the key of an invalid value.
  void check() const;

  friend bool operator==(const BeliefOptions&, const BeliefOptions&) = default;
};

/// Adds all options.
void describe(OptionList& list, BeliefOptions& options);

/// Initial belief that an instance is static, from class and flag of its prior. Immutable.
class InitialBelief {
 public:
  /// Every class is kFixed.
  InitialBelief() = default;
  InitialBelief(const BeliefOptions& options, const LabelSpace& space);

  [[nodiscard]] Mobility mobility(std::uint16_t label) const {
    return label < mobility_.size() ? mobility_[label] : Mobility::kFixed;
  }
  /// Initial log-odds of being static, nats. The class of `prior` must not be kFixed.
  [[nodiscard]] double log_odds(const Prior& prior) const;

 private:
  BeliefOptions options_;
  std::vector<Mobility> mobility_;  // by label
};

/// The prior with belief in place of the file's motion: mu = 100 (1 - p_static), so that gates and
/// the motion factor of Eq. 9 use it. `dynamic` is 1 when p_static < 0.5.
Prior with_belief(const Prior& prior, double p_static);

/// p_static, 0..1, of a prior returned by with_belief().
inline float p_static(const Prior& prior) {
  return 1.0f - 0.01f * prior.motion;
}

}  // namespace kys
