// SPDX-License-Identifier: BSD-3-Clause
#include <kys/error.h>
#include <kys/mode_options.h>

namespace kys {

namespace {

constexpr std::array<std::string_view, 9> kModeNames = {"stock",       "scaled",   "hard_mismatch",
                                                        "soft_filter", "semantic", "panoptic",
                                                        "kys",         "mask",     "verified"};

}  // namespace

std::string_view mode_name(Mode mode) {
  return kModeNames.at(static_cast<std::size_t>(mode));
}

Mode parse_mode(std::string_view name) {
  std::string known;
  for (std::size_t i = 0; i < kModeNames.size(); ++i) {
    if (name == kModeNames[i]) {
      return static_cast<Mode>(i);
    }
    known += (i == 0 ? "" : ", ") + std::string(kModeNames[i]);
  }
  throw Error("unknown mode '" + std::string(name) + "' (known: " + known + ")");
}

const std::array<Mode, 9>& all_modes() {
  static constexpr std::array<Mode, 9> kModes = {
      Mode::kStock,    Mode::kScaled, Mode::kHardMismatch, Mode::kSoftFilter, Mode::kSemantic,
      Mode::kPanoptic, Mode::kKys,    Mode::kMask,         Mode::kVerified};
  return kModes;
}

void describe(OptionList& list, ModeOptions& o) {
  // The upper limit keeps every product finite, the smallest value every quotient.
  constexpr double kLimit = 1e6;
  constexpr double kSmallest = 1e-3;
  list.add("kys.mode", o.mode, {kModeNames.begin(), kModeNames.end()},
           "stock, scaled, hard_mismatch, soft_filter, semantic, panoptic, kys, mask or verified");
  list.add("kys.s", o.s, {kSmallest, kLimit}, "", "scaled: factor on every distance");
  list.add("kys.tau", o.tau, {kSmallest, kLimit}, "bits",
           "soft_filter: semantic distance from which a pair is rejected");
  list.add("kys.alpha", o.alpha, {0, 1}, "",
           "semantic: weight of the Hamming against the semantic distance");
  list.add("kys.eta1", o.eta[0], {kSmallest, kLimit}, "",
           "panoptic, kys, verified: factor when the classes differ");
  list.add("kys.eta2", o.eta[1], {0, kLimit}, "",
           "panoptic, kys, verified: added to eta1 for a semantic distance of s_max");
  list.add("kys.eta3", o.eta[2], {0, kLimit}, "",
           "panoptic, kys, verified: added for the largest discrepancy of the scales");
  list.add("kys.gamma", o.gamma, {kSmallest, kLimit}, "",
           "panoptic, kys, verified: factor when the classes are the same");
  list.add("kys.s_max", o.s_max, {kSmallest, kLimit}, "bits",
           "panoptic, kys, verified: semantic distance that counts as 1");
  list.add("kys.normalize", o.normalize,
           "panoptic, kys, verified: factors are divided by gamma, so that thresholds keep their "
           "meaning");
  list.add("kys.lambda_cross_class", o.lambda[0], {0, kLimit}, "",
           "kys, verified: weight of ln(1 + motion), classes differ");
  list.add("kys.lambda_cross_instance", o.lambda[1], {0, kLimit}, "",
           "kys, verified: weight of ln(1 + motion), one class, instances differ");
  list.add("kys.lambda_same_instance", o.lambda[2], {0, kLimit}, "",
           "kys, verified: weight of ln(1 + motion), one instance");
  list.add("kys.gates", o.gates, "kys, verified: pairs with motion above a gate are rejected");
  list.add("kys.gate_stereo", o.gate_stereo, {0, kLimit}, "",
           "kys: largest motion, 0 to 100, that is matched between the cameras");
  list.add("kys.gate_temporal", o.gate_temporal, {0, kLimit}, "",
           "kys: largest motion, 0 to 100, that is matched between frames");
  list.add("kys.continuous", o.continuous,
           "kys, verified: when false, gates only: pairs that pass keep the Hamming distance");
  list.add("kys.gate_belief", o.gate_belief, {0, 1}, "",
           "verified: largest probability of moving that is matched between frames, in place of "
           "kys.gate_temporal");
}

void ModeOptions::check() const {
  const std::string complaint = complaint_about(*this);
  if (!complaint.empty()) throw Error(complaint);
}

bool needs_priors(Mode mode) {
  return mode != Mode::kStock && mode != Mode::kScaled;
}

bool needs_label_space(const ModeOptions& options) {
  switch (options.mode) {
    case Mode::kSoftFilter:
    case Mode::kSemantic:
    case Mode::kPanoptic:
    case Mode::kVerified:
      return true;
    case Mode::kKys:
      return options.continuous;
    default:
      return false;
  }
}

void set_option(ModeOptions& options, std::string_view key, std::string_view value) {
  OptionList list;
  describe(list, options);
  for (const Option& option : list.options()) {
    if (option.key != key) continue;
    if (option.parse(value)) return;
    throw Error(option.key + " must be " + option.expected() + ", is '" + std::string(value) + "'");
  }
  throw Error("unknown setting '" + std::string(key) + "'");
}

std::vector<std::pair<std::string, std::string>> option_values(const ModeOptions& options) {
  ModeOptions copy = options;
  OptionList list;
  describe(list, copy);
  std::vector<std::pair<std::string, std::string>> values;
  for (const Option& option : list.options()) values.emplace_back(option.key, option.text());
  return values;
}

}  // namespace kys
