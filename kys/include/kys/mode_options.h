// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace kys {

/// The matching modes of the paper and its ablations. d: Hamming distance, S: semantic distance.
enum class Mode : std::uint8_t {
  kStock,         ///< d
  kScaled,        ///< s d: a constant factor on every distance (control)
  kHardMismatch,  ///< d; rejected when the labels differ
  kSoftFilter,    ///< d; rejected when S >= tau
  kSemantic,      ///< alpha d + (1 - alpha) S (Eq. 2)
  kPanoptic,      ///< structural factor (Eqs. 4-5)
  kKys,           ///< gates, structural factor and motion (Eq. 9)
  kMask,          ///< d; keypoints of moving segments are dropped at extraction (control)
  kVerified,      ///< Eq. 9 with belief (belief.h) in place of the file's motion
};

/// The name of a mode: "stock", "scaled", "hard_mismatch", "soft_filter", "semantic", "panoptic",
/// "kys", "mask", "verified".
std::string_view mode_name(Mode mode);

/// The mode of that name. Throws Error naming the known modes when there is none.
Mode parse_mode(std::string_view name);

/// All modes, in the order of the enumeration.
const std::array<Mode, 9>& all_modes();

/// Every coefficient of every mode. The defaults are the paper's, with two exceptions: `mode` is
/// stock, and `normalize` is on.
struct ModeOptions {
  Mode mode = Mode::kStock;

  double s = 0.75;     ///< mode `scaled`: factor on d
  double tau = 110;    ///< mode soft_filter: bits of S from which a pair is rejected
  double alpha = 0.7;  ///< mode semantic: weight of d, 1 - alpha that of S

  // Modes panoptic, kys and verified.
  std::array<double, 3> eta{0.70, 0.20, 0.10};  ///< cross-class base, weight of S / S_max, of scale
  double gamma = 0.75;                          ///< base of same-class pairs
  double s_max = 155;     ///< bits of S that correspond to 1; S is not clipped
  bool normalize = true;  ///< divide the structural factor by gamma (the paper does not)

  // Modes kys and verified.
  std::array<double, 3> lambda{0.08, 0.05, 0.02};  ///< cross-class, cross-instance, same-instance
  bool gates = true;                               ///< reject pairs with mu above a gate
  double gate_stereo = 8;     ///< mode kys: largest mu, 0..100, matched left to right
  double gate_temporal = 20;  ///< mode kys: largest mu, 0..100, matched in other contexts
  bool continuous = true;     ///< false: gates only, other pairs keep d

  /// Mode verified: largest 1 - p_static, 0..1, matched between frames. It replaces gate_temporal.
  double gate_belief = 0.7;

  /// Throws Error naming the key of an invalid value.
  void check() const;

  friend bool operator==(const ModeOptions&, const ModeOptions&) = default;
};

/// Adds all options, in the order of README.md.
void describe(OptionList& list, ModeOptions& options);

/// Whether a mode needs priors: all but `stock` and `scaled`. Without priors such a mode equals
/// `stock`.
bool needs_priors(Mode mode);

/// Whether a model with these options needs a label space (uses S).
bool needs_label_space(const ModeOptions& options);

/// Sets the option of that key (README.md lists them, "kys.alpha" etc.) from its text form.
/// Throws Error for unknown keys and for text that is not a value of the option's type.
void set_option(ModeOptions& options, std::string_view key, std::string_view value);

/// All options as (key, text) pairs, in the order of README.md; set_option() reads them back.
std::vector<std::pair<std::string, std::string>> option_values(const ModeOptions& options);

}  // namespace kys
