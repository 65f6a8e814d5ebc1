#pragma once

#include <kys/distance.h>
#include <kys/label_space.h>
#include <kys/option_list.h>

#include <cstdint>
#include <string_view>
#include <vector>

namespace kys {

/// Whether things of a class can move by themselves.
enum class Mobility : std::uint8_t {
  kFixed,    ///< stuff, and whatever has no valid label
  kCarried,  ///< things that move only when somebody moves them: chairs, bags
  kMobile,   ///< people, animals, vehicles
};

/// Of a class, by its name and thing flag ("car", "Van", "person", ...).
Mobility mobility(const LabelClass& label_class);

/// Log-odds ln(p / (1 - p)) of standing still that a prior file gives a thing. The numbers of a
/// class are those of a file that does not judge motion; its judgement adds its own.
struct BeliefOptions {
  double carried = 3;      ///< class that is carried
  double mobile = 0.5;     ///< class that can move by itself
  double flagged = -1.5;   ///< added: the file calls it moving
  double unflagged = 0.5;  ///< added: it does not

  /// Throws Error, naming the key, when a value makes no sense.
  void check() const;

  friend bool operator==(const BeliefOptions&, const BeliefOptions&) = default;
};

/// Adds all options.
void describe(OptionList& list, BeliefOptions& options);

/// Where belief in a thing's standing still starts: from class and flag of its prior. Immutable.
class BeliefStart {
 public:
  /// Nothing can move.
  BeliefStart() = default;
  BeliefStart(const BeliefOptions& options, const LabelSpace& space);

  [[nodiscard]] Mobility mobility(std::uint16_t label) const {
    return label < mobility_.size() ? mobility_[label] : Mobility::kFixed;
  }
  /// Log-odds of standing still; that of a fixed class is not asked for.
  [[nodiscard]] double log_odds(const Prior& prior) const;

 private:
  BeliefOptions options_;
  std::vector<Mobility> mobility_;  // by label
};

/// The prior with belief in the place of the file's motion: mu = 100 (1 - p_static), so that gates
/// and the motion factor of Eq. 9 act on it; flagged when moving is the likelier.
Prior believed(const Prior& prior, double p_static);

/// p_static of a prior that believed() made.
inline float p_static(const Prior& prior) {
  return 1.0f - 0.01f * prior.motion;
}

}  // namespace kys
