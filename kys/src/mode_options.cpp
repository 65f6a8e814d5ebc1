#include <kys/error.h>
#include <kys/mode_options.h>
#include <kys/option_description.h>

#include <charconv>
#include <cmath>
#include <system_error>
#include <type_traits>

namespace kys {

namespace {

constexpr std::array<std::string_view, 9> kModeNames = {"stock",       "scaled",   "hard_mismatch",
                                                        "soft_filter", "semantic", "panoptic",
                                                        "kys",         "mask",     "verified"};

/// Calls visit(key, member) for every option: the one place where keys and members meet.
template <typename Options, typename Visit>
void for_each_option(Options& o, Visit&& visit) {
  visit("kys.mode", o.mode);
  visit("kys.s", o.s);
  visit("kys.tau", o.tau);
  visit("kys.alpha", o.alpha);
  visit("kys.eta1", o.eta[0]);
  visit("kys.eta2", o.eta[1]);
  visit("kys.eta3", o.eta[2]);
  visit("kys.gamma", o.gamma);
  visit("kys.s_max", o.s_max);
  visit("kys.normalize", o.normalize);
  visit("kys.lambda_cross_class", o.lambda[0]);
  visit("kys.lambda_cross_instance", o.lambda[1]);
  visit("kys.lambda_same_instance", o.lambda[2]);
  visit("kys.gates", o.gates);
  visit("kys.gate_stereo", o.gate_stereo);
  visit("kys.gate_temporal", o.gate_temporal);
  visit("kys.continuous", o.continuous);
  visit("kys.gate_belief", o.gate_belief);
}

void parse(std::string_view, std::string_view text, Mode& value) {
  value = parse_mode(text);
}

void parse(std::string_view key, std::string_view text, bool& value) {
  if (text == "true") {
    value = true;
  } else if (text == "false") {
    value = false;
  } else {
    throw Error(std::string(key) + " must be true or false, is '" + std::string(text) + "'");
  }
}

void parse(std::string_view key, std::string_view text, double& value) {
  double parsed = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, parsed);
  if (error != std::errc() || stop != end || !std::isfinite(parsed)) {
    throw Error(std::string(key) + " must be a finite number, is '" + std::string(text) + "'");
  }
  value = parsed;
}

std::string text_of(Mode value) {
  return std::string(mode_name(value));
}
std::string text_of(bool value) {
  return value ? "true" : "false";
}
std::string text_of(double value) {
  std::array<char, 32> buffer;
  const auto result = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value);
  return std::string(buffer.data(), result.ptr);
}

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

void ModeOptions::check() const {
  if (static_cast<std::size_t>(mode) >= kModeNames.size()) {
    throw Error("kys.mode is not one of the modes");
  }
  auto description = option_descriptions().begin();
  for_each_option(*this, [&](std::string_view key, const auto& value) {
    const OptionDescription& option = *description++;
    if constexpr (std::is_same_v<std::decay_t<decltype(value)>, double>) {
      if (value >= option.least && value <= option.most) return;  // what is not a number does not
      throw Error(std::string(key) + " must be between " + text_of(option.least) + " and " +
                  text_of(option.most) + ", is " + text_of(value));
    }
  });
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
  bool found = false;
  for_each_option(options, [&](std::string_view name, auto& member) {
    if (name == key) {
      parse(key, value, member);
      found = true;
    }
  });
  if (!found) {
    throw Error("unknown setting '" + std::string(key) + "'");
  }
}

std::vector<std::pair<std::string, std::string>> option_values(const ModeOptions& options) {
  std::vector<std::pair<std::string, std::string>> values;
  for_each_option(options, [&](std::string_view key, const auto& member) {
    values.emplace_back(key, text_of(member));
  });
  return values;
}

const std::vector<OptionDescription>& option_descriptions() {
  // The upper limit keeps every product finite, the smallest value every quotient.
  constexpr double kLimit = 1e6;
  constexpr double kSmallest = 1e-3;
  static const std::vector<OptionDescription> kAll = {
      {"kys.mode", "", 0, 0,
       "stock, scaled, hard_mismatch, soft_filter, semantic, panoptic, kys, mask or verified"},
      {"kys.s", "", kSmallest, kLimit, "scaled: factor on every distance"},
      {"kys.tau", "bits", kSmallest, kLimit,
       "soft_filter: semantic distance from which a pair is rejected"},
      {"kys.alpha", "", 0, 1, "semantic: weight of the Hamming against the semantic distance"},
      {"kys.eta1", "", kSmallest, kLimit, "panoptic, kys: factor when the classes differ"},
      {"kys.eta2", "", 0, kLimit, "panoptic, kys: what a semantic distance of s_max adds to eta1"},
      {"kys.eta3", "", 0, kLimit, "panoptic, kys: what the discrepancy of the scales adds"},
      {"kys.gamma", "", kSmallest, kLimit, "panoptic, kys: factor when the classes are the same"},
      {"kys.s_max", "bits", kSmallest, kLimit, "panoptic, kys: semantic distance that counts as 1"},
      {"kys.normalize", "", 0, 0,
       "panoptic, kys: factors are divided by gamma, so that thresholds keep their meaning"},
      {"kys.lambda_cross_class", "", 0, kLimit, "kys: weight of ln(1 + motion), classes differ"},
      {"kys.lambda_cross_instance", "", 0, kLimit, "kys: the same, one class, instances differ"},
      {"kys.lambda_same_instance", "", 0, kLimit, "kys: the same, one instance"},
      {"kys.gates", "", 0, 0, "kys: pairs with a moving end are rejected"},
      {"kys.gate_stereo", "", 0, kLimit,
       "kys: largest motion, 0 to 100, that is matched between the cameras"},
      {"kys.gate_temporal", "", 0, kLimit,
       "kys: largest motion, 0 to 100, that is matched between frames"},
      {"kys.continuous", "", 0, 0,
       "kys: false: gates only, pairs that pass keep the Hamming distance"},
      {"kys.gate_belief", "", 0, 1,
       "verified: largest probability of moving that is matched between frames"},
  };
  return kAll;
}

}  // namespace kys
