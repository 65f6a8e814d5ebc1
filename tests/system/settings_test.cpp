// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <kys_slam/error.h>
#include <kys_slam/settings.h>

#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <string>

#include "io/renamed_settings.h"

namespace kys_slam {
namespace {

std::optional<double> number(const std::string& text) {
  double value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

struct Range {
  double least, most;
};

/// "1 to 32" as --list-settings tells it.
std::optional<Range> parse_range(const std::string& text) {
  const std::size_t to = text.find(" to ");
  if (to == std::string::npos) return std::nullopt;
  const auto least = number(text.substr(0, to)), most = number(text.substr(to + 4));
  if (!least || !most) return std::nullopt;
  return Range{*least, *most};
}

/// Whether the value is refused, when it is set or when all settings are checked.
bool refused(const std::string& key, const std::string& value) {
  Settings settings;
  try {
    settings.set(key, value);
    settings.check();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(key), std::string::npos) << error.what();
    return true;
  }
  return false;
}

TEST(Settings, EveryNumberHasARangeThatIsKept) {
  std::size_t numbers = 0;
  for (const Settings::Description& d : Settings().describe()) {
    EXPECT_GT(d.meaning.size(), 5u) << d.key;
    EXPECT_EQ(d.meaning.find("README.md"), std::string::npos) << d.key;
    const auto value = number(d.value);
    if (!value) continue;
    ++numbers;
    SCOPED_TRACE(d.key);
    const auto range = parse_range(d.range);
    ASSERT_TRUE(range.has_value()) << "'" << d.range << "'";
    EXPECT_LT(range->least, range->most);
    EXPECT_GE(*value, range->least);
    EXPECT_LE(*value, range->most);
    EXPECT_FALSE(refused(d.key, d.value));
    EXPECT_TRUE(refused(d.key, fmt::format("{}", range->least - 1)));
    EXPECT_TRUE(refused(d.key, fmt::format("{:.0f}", range->most * 1.01 + 1)));
  }
  EXPECT_GT(numbers, 100u);
}

TEST(Settings, HaveTypes) {
  using Type = Settings::Type;
  for (const Settings::Description& d : Settings().describe()) {
    SCOPED_TRACE(d.key);
    const auto range = parse_range(d.range);
    EXPECT_EQ(d.type == Type::kInteger || d.type == Type::kReal, range.has_value());
    if (range) {
      EXPECT_EQ(d.least, range->least);
      EXPECT_EQ(d.most, range->most);
    }
    EXPECT_EQ(d.type == Type::kTruth, d.value == "true" || d.value == "false");
    EXPECT_EQ(d.type == Type::kChoice, !d.choices.empty());
    for (const std::string& choice : d.choices) EXPECT_FALSE(refused(d.key, choice));
    if (d.type == Type::kInteger || d.type == Type::kTruth) {
      EXPECT_TRUE(refused(d.key, "0.5"));
    }
  }
}

TEST(Settings, NumbersOutsideAnySenseAreRefused) {
  for (const Settings::Description& d : Settings().describe()) {
    if (!number(d.value)) continue;
    SCOPED_TRACE(d.key);
    for (const char* text :
         {"nan", "inf", "-inf", "-1e9", "1e300", "1e999", "", " ", "1 ", "0x10"}) {
      EXPECT_TRUE(refused(d.key, text)) << "'" << text << "'";
    }
  }
}

TEST(Settings, AnEarlierNameIsRefusedWithThePresentOne) {
  for (const RenamedSetting& renamed : kRenamedSettings) {
    SCOPED_TRACE(renamed.before);
    EXPECT_NO_THROW((void)Settings().get(renamed.now));
    EXPECT_THROW((void)Settings().get(renamed.before), InputError);
    try {
      Settings().set(renamed.before, Settings().get(renamed.now));
      FAIL() << "is accepted";
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()),
                fmt::format("setting '{}' is now called '{}'", renamed.before, renamed.now));
    }
  }
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / "kys_renamed_settings_test.yaml";
  std::ofstream(file) << "tracking:\n  balanced: false\n";
  Settings settings;
  try {
    settings.load(file);
    ADD_FAILURE() << "is accepted in a file";
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()),
              file.string() + ": setting 'tracking.balanced' is now called 'tracking.image_area'");
  }
  std::filesystem::remove(file);
}

TEST(Settings, AreReadBackAsTheyWere) {
  Settings settings;
  settings.set("tracking.outlier_area", "0.123456789012");
  settings.set("belief.carried", "-1.0000001");
  settings.set("loop.enabled", "false");
  settings.set("control.label_space", "a folder/b: \"c\" # 'd'\\");
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / "kys_settings_test.yaml";
  std::ofstream(file) << settings.to_yaml();
  Settings again;
  again.load(file);
  std::filesystem::remove(file);
  EXPECT_EQ(again.to_yaml(), settings.to_yaml());
  EXPECT_EQ(again.get("control.label_space"), settings.get("control.label_space"));
  EXPECT_EQ(again.get("belief.carried"), "-1.0000001");
  EXPECT_TRUE(refused("control.label_space", "a\nb"));
  EXPECT_TRUE(refused("control.label_space", std::string(3000, 'a')));
}

TEST(Settings, ChoicesAndTruthValuesAreChecked) {
  EXPECT_TRUE(refused("loop.enabled", "yes"));
  EXPECT_TRUE(refused("loop.enabled", ""));
  EXPECT_THROW(Settings().set("kys.mode", "everything"), InputError);
  EXPECT_THROW(Settings().set("orb.lvels", "8"), InputError);
}

}  // namespace
}  // namespace kys_slam
