// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/options_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/nearest_name.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "io/renamed_settings.h"
#include "io/yaml_file.h"

namespace kys_slam {
namespace {

/// Throws InputError when `text` is not a value of the option's type, or out of its range.
void set_from_text(const kys::Option& option, std::string_view text) {
  const auto fail = [&](const std::string& what) {
    throw InputError("setting " + option.key + ": '" + std::string(text.substr(0, 80)) +
                     "' is not " + what);
  };
  constexpr std::size_t kLongest = 2000;  // bytes
  if (printable(text, kLongest) != text) fail("a line of at most 2000 printable characters");
  const std::string before = option.text();
  if (!option.parse(text)) fail(option.expected());
  if (option.complaint().empty()) return;
  (void)option.parse(before);
  fail("from " + option.range_text());
}

void flatten(const YAML::Node& node, const std::string& prefix, const std::string& file,
             std::vector<std::pair<std::string, std::string>>& entries) {
  for (const auto& entry : node) {
    const std::string key = prefix + entry.first.as<std::string>();
    if (entry.second.IsMap()) {
      flatten(entry.second, key + ".", file, entries);
    } else if (entry.second.IsScalar()) {
      entries.emplace_back(key, entry.second.as<std::string>());
    } else {
      throw InputError(file + ": setting " + key + " has no single value");
    }
  }
}

}  // namespace

void set_option(const kys::OptionList& list, std::string_view key, std::string_view value) {
  std::vector<std::string> known;
  for (const kys::Option& option : list.options()) {
    if (!option.settable) continue;
    if (option.key == key) return set_from_text(option, value);
    known.push_back(option.key);
  }
  const auto* renamed = std::ranges::find(kRenamedSettings, key, &RenamedSetting::before);
  if (renamed != kRenamedSettings.end()) {
    throw InputError(fmt::format("setting '{}' is now called '{}'", key, renamed->now));
  }
  throw InputError("unknown setting '" + std::string(key) + "'" + did_you_mean(key, known));
}

void load_option_list(const std::filesystem::path& file, const kys::OptionList& list) {
  std::vector<std::pair<std::string, std::string>> entries;
  try {
    const YAML::Node root = load_yaml(file);
    if (!root.IsNull() && !root.IsMap()) {
      throw InputError(file.string() + ": is not a list of settings");
    }
    if (root.IsMap()) flatten(root, "", file.string(), entries);
  } catch (const YAML::Exception& error) {
    throw InputError(file.string() + ": " + error.what());
  }
  try {
    for (const auto& [key, value] : entries) set_option(list, key, value);
  } catch (const InputError& error) {
    throw InputError(file.string() + ": " + error.what());
  }
}

}  // namespace kys_slam
