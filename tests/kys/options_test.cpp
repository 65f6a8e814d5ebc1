// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <kys/belief.h>
#include <kys/option_list.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <string>

#include "test_support.h"

namespace kys::test {
namespace {

TEST(Options, ModeNamesRoundTrip) {
  for (const Mode mode : all_modes()) {
    EXPECT_EQ(parse_mode(mode_name(mode)), mode);
  }
  EXPECT_EQ(mode_name(Mode::kHardMismatch), "hard_mismatch");
  for (const char* bad : {"", "KYS", "kys ", "semantics"}) {
    EXPECT_THROW((void)parse_mode(bad), Error);
  }
}

TEST(Options, DefaultsAreThePapers) {
  const ModeOptions o;
  EXPECT_NO_THROW(o.check());
  EXPECT_EQ(o.s, 0.75);
  EXPECT_EQ(o.tau, 110);
  EXPECT_EQ(o.alpha, 0.7);
  EXPECT_EQ(o.eta, (std::array<double, 3>{0.70, 0.20, 0.10}));
  EXPECT_EQ(o.gamma, 0.75);
  EXPECT_EQ(o.s_max, 155);
  EXPECT_EQ(o.lambda, (std::array<double, 3>{0.08, 0.05, 0.02}));
  EXPECT_EQ(o.gate_stereo, 8);
  EXPECT_EQ(o.gate_temporal, 20);
  EXPECT_TRUE(o.normalize && o.gates && o.continuous);
}

TEST(Options, KeysReadBackWhatTheyWrite) {
  ModeOptions changed;
  changed.mode = Mode::kSoftFilter;
  changed.alpha = 1.0 / 3.0;
  changed.eta = {0.61, 0.31, 0.07};
  changed.lambda = {1e-9, 0, 7};
  changed.normalize = changed.gates = changed.continuous = false;
  ModeOptions read;
  for (const auto& [key, text] : option_values(changed)) {
    set_option(read, key, text);
  }
  EXPECT_EQ(read, changed);
}

/// A value just outside of the range is refused, the ends are not; a text is refused by its key.
template <typename Options>
void expect_checked() {
  Options options;
  OptionList list;
  describe(list, options);
  for (const Option& option : list.options()) {
    EXPECT_GT(option.meaning.size(), 10u) << option.key;
    const std::string before = option.text();
    const bool number = before.find_first_not_of("0123456789.e-+") == std::string::npos;
    ASSERT_EQ(option.is_number(), number) << option.key;
    if (!number) continue;
    for (const double good : {option.range.least, option.range.most}) {
      ASSERT_TRUE(option.parse(std::to_string(good)));
      EXPECT_NO_THROW(options.check()) << option.key << " " << good;
    }
    for (const double bad : {option.range.least - 0.01, option.range.most * 1.01}) {
      ASSERT_TRUE(option.parse(std::to_string(bad)));
      EXPECT_THROW(options.check(), Error) << option.key << " " << bad;
    }
    EXPECT_FALSE(option.parse("much"));
    ASSERT_TRUE(option.parse(before));
    EXPECT_EQ(options, Options());
  }
}

TEST(Options, EveryOneIsDescribedAndChecked) {
  expect_checked<ModeOptions>();
  expect_checked<BeliefOptions>();
}

TEST(Options, ANumberThatIsNoModeIsRefused) {
  ModeOptions options;
  options.mode = static_cast<Mode>(9);
  EXPECT_THROW(options.check(), Error);
}

/// Sets what a configuration file of the tree says under `kys`; returns how many keys that are.
int read_config(const std::string& name, ModeOptions& options) {
  std::ifstream file(std::string(KYS_SOURCE_DIR) + "/configs/" + name);
  int count = 0;
  bool ours = false;
  for (std::string line; std::getline(file, line);) {
    if (!line.starts_with(' ') && !line.starts_with('#')) ours = line.starts_with("kys:");
    const std::size_t colon = line.find(": ");
    if (ours && line.starts_with("  ") && colon != std::string::npos) {
      const std::size_t value = colon + 2;
      set_option(options, "kys." + line.substr(2, colon - 2),
                 line.substr(value, line.find(' ', value) - value));
      ++count;
    }
  }
  return count;
}

TEST(Options, ConfigurationFilesOfTheTree) {
  ModeOptions defaults;
  for (const auto& [key, text] : option_values(defaults)) {
    if (key != "kys.mode" && text != "true") set_option(defaults, key, "1");
  }
  defaults.normalize = defaults.gates = defaults.continuous = false;
  EXPECT_EQ(read_config("kys_default.yaml", defaults), 17);  // all but the mode
  EXPECT_EQ(defaults, ModeOptions{});
  ModeOptions paper;
  EXPECT_EQ(read_config("kys_paper.yaml", paper), 1);
  ModeOptions expected;
  expected.normalize = false;
  EXPECT_EQ(paper, expected);
}

TEST(Options, BadKeysAndValues) {
  ModeOptions o;
  EXPECT_THROW(set_option(o, "kys.beta", "1"), Error);
  EXPECT_THROW(set_option(o, "alpha", "1"), Error);
  EXPECT_THROW(set_option(o, "kys.mode", "fast"), Error);
  for (const char* bad : {"", "x", "1,5", "1 ", "nan", "inf", "0x10", "1e999"}) {
    EXPECT_THROW(set_option(o, "kys.alpha", bad), Error) << bad;
  }
  for (const char* bad : {"", "1", "True", "yes"}) {
    EXPECT_THROW(set_option(o, "kys.gates", bad), Error) << bad;
  }
  EXPECT_EQ(o, ModeOptions{});
}

TEST(Options, CheckNamesTheKey) {
  const auto complaint = [](const char* key, double value) -> std::string {
    ModeOptions o;
    set_option(o, key, std::to_string(value));
    try {
      o.check();
    } catch (const Error& error) {
      return error.what();
    }
    return "nothing";
  };
  EXPECT_EQ(complaint("kys.alpha", 1.5), "kys.alpha must be between 0 and 1, is 1.5");
  EXPECT_EQ(complaint("kys.gamma", 0), "kys.gamma must be between 0.001 and 1000000, is 0");
  EXPECT_EQ(complaint("kys.tau", 0), "kys.tau must be between 0.001 and 1000000, is 0");
  EXPECT_EQ(complaint("kys.lambda_cross_class", -1),
            "kys.lambda_cross_class must be between 0 and 1000000, is -1");
  EXPECT_EQ(complaint("kys.lambda_cross_class", 0), "nothing");
  EXPECT_EQ(complaint("kys.gate_stereo", 0), "nothing");
  ModeOptions o;
  o.eta[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(o.check(), Error);
  EXPECT_THROW(DistanceModel{o}, Error);
}

TEST(Options, ModesThatLookAtSNeedALabelSpace) {
  for (const Mode mode : all_modes()) {
    const bool needs = needs_label_space(options_of(mode));
    EXPECT_EQ(needs, mode == Mode::kSoftFilter || mode == Mode::kSemantic ||
                         mode == Mode::kPanoptic || mode == Mode::kKys || mode == Mode::kVerified);
    if (needs) {
      EXPECT_THROW(DistanceModel{options_of(mode)}, Error);
    } else {
      EXPECT_NO_THROW(DistanceModel{options_of(mode)});
    }
  }
}

TEST(Options, ModesThatSayNothingWithoutPriors) {
  for (const Mode mode : all_modes()) {
    EXPECT_EQ(needs_priors(mode), mode != Mode::kStock && mode != Mode::kScaled);
  }
}

TEST(Prior, IsCheckedClippedAndHasItsLogarithm) {
  const Prior p = make_prior(7, 42, 12.5f, 3.0f, true);
  EXPECT_EQ(p.label, 7);
  EXPECT_EQ(p.instance, 42);
  EXPECT_EQ(p.scale, 12.5f);
  EXPECT_EQ(p.dynamic, 1);
  EXPECT_FLOAT_EQ(p.log_motion, 1.3862944f);  // ln 4
  EXPECT_EQ(make_prior(7, 42, 0, -5, false).motion, 0.0f);
  EXPECT_EQ(make_prior(7, 42, 0, -5, false).log_motion, 0.0f);
  EXPECT_EQ(make_prior(7, 42, 0, 250, false).motion, 100.0f);
  EXPECT_FLOAT_EQ(make_prior(7, 42, 0, 250, false).log_motion, 4.6151205f);  // ln 101
  const float nan = std::nanf("");
  const float inf = std::numeric_limits<float>::infinity();
  for (const float bad : {nan, inf, -inf, -1.0f}) {
    EXPECT_THROW((void)make_prior(7, 42, bad, 0, false), Error);
  }
  for (const float bad : {nan, inf, -inf}) {
    EXPECT_THROW((void)make_prior(7, 42, 0, bad, false), Error);
  }
  static_assert(sizeof(Prior) == 20);
}

TEST(Prior, OfALandmark) {
  const Prior representative = make_prior(3, 11, 500, 40, true);
  const Prior recent = make_prior(4, 12, 900, 2, false);
  const Prior merged = landmark_prior(representative, recent);
  EXPECT_EQ(merged, make_prior(3, 11, 500, 2, false));  // what, from one; how fast, from the other
  EXPECT_EQ(landmark_prior(representative, Prior{}), make_prior(3, 11, 500, 0, false));
  EXPECT_EQ(landmark_prior(Prior{}, recent).label, kVoidLabel);
}

}  // namespace
}  // namespace kys::test
