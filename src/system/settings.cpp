// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/option_list.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/settings.h>
#include <kys_slam/util/nearest_name.h>

#include <algorithm>
#include <cctype>
#include <sstream>

#include "io/yaml_file.h"
#include "system/settings_data.h"

namespace kys_slam {

void describe(kys::OptionList& list, ControlOptions& o) {
  list.add("control.pipeline_delay", o.pipeline_delay, {0, 1000}, "frames",
           "after which the tracker receives the changes of the back end (pipelined)");
  list.add("control.blend_poses", o.blend_poses,
           "frames between two keyframes move with both; false: with the one before");
  list.add("control.stall_ms", o.stall_ms, {0, 60000}, "ms",
           "slept in every frame, for studies of time budgets");
  list.add("control.label_space", o.label_space, "label space of the prior files");
}

void describe(kys::OptionList& list, SettingsData& o) {
  describe(list, o.orb);
  describe(list, o.stereo);
  describe(list, o.tracking);
  describe(list, o.mapping);
  describe(list, o.loop);
  describe(list, o.full_bundle);
  describe(list, o.relocalization);
  describe(list, o.place);
  describe(list, o.belief);
  describe(list, o.objects);
  describe(list, o.control);
  describe(list, o.kys);
}

namespace {

/// All settings; the list points into the data.
kys::OptionList list_of(SettingsData& data) {
  kys::OptionList list;
  describe(list, data);
  return list;
}

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

/// A value as YAML reads it back: texts with anything but letters, digits and a few more in quotes.
std::string yaml_value(const std::string& value) {
  const bool plain = std::all_of(value.begin(), value.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '.' || c == '/' || c == '-' || c == '+';
  });
  if (plain && !value.empty()) return value;
  std::string quoted = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') quoted += '\\';
    quoted += c;
  }
  return quoted + "\"";
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
      throw InputError(fmt::format("{}: setting {} has no single value", file, key));
    }
  }
}

}  // namespace

Settings::Settings() : data_(std::make_unique<SettingsData>()) {}
Settings::~Settings() = default;
Settings::Settings(const Settings& other)
    : data_(std::make_unique<SettingsData>(*other.data_)),
      file_(other.file_),
      contradiction_(other.contradiction_) {}
Settings& Settings::operator=(const Settings& other) {
  *data_ = *other.data_;
  file_ = other.file_;
  contradiction_ = other.contradiction_;
  return *this;
}
Settings::Settings(Settings&&) noexcept = default;
Settings& Settings::operator=(Settings&&) noexcept = default;

Settings Settings::indoor() {
  Settings settings;
  settings.data_->orb.features = 1200;
  settings.data_->tracking.close_baselines = 60;
  settings.data_->tracking.keyframes.max_frames = 20;
  return settings;
}

void Settings::assign(std::string_view assignment) {
  const std::size_t equals = assignment.find('=');
  if (equals == std::string_view::npos) {
    throw InputError("'" + std::string(assignment) + "' sets nothing: KEY=VALUE expected");
  }
  set(assignment.substr(0, equals), assignment.substr(equals + 1));
}

void Settings::set(std::string_view key, std::string_view value) {
  std::vector<std::string> known;
  for (const kys::OptionList list = list_of(*data_); const kys::Option& option : list.options()) {
    if (!option.settable) continue;
    if (option.key == key) return set_from_text(option, value);
    known.push_back(option.key);
  }
  throw InputError("unknown setting '" + std::string(key) + "'" + did_you_mean(key, known));
}

std::string Settings::get(std::string_view key) const {
  for (const Description& d : describe()) {
    if (d.key == key) return d.value;
  }
  throw InputError("unknown setting '" + std::string(key) + "'");
}

void Settings::load(const std::filesystem::path& file) {
  std::vector<std::pair<std::string, std::string>> entries;
  try {
    const YAML::Node root = load_yaml(file);
    if (!root.IsNull() && !root.IsMap()) {
      throw InputError(file.string() + ": is not a list of settings");
    };
    if (root.IsMap()) flatten(root, "", file.string(), entries);
  } catch (const YAML::Exception& error) {
    throw InputError(file.string() + ": " + error.what());
  }
  try {
    for (const auto& [key, value] : entries) set(key, value);
  } catch (const InputError& error) {
    throw InputError(file.string() + ": " + error.what());
  }
  // What is set later may put it right.
  file_ = file.string();
  contradiction_ = kys::complaint_about(*data_);
}

void Settings::check() const {
  const std::string complaint = kys::complaint_about(*data_);
  if (complaint.empty()) return;
  throw InputError(complaint == contradiction_ ? file_ + ": " + complaint : complaint);
}

std::vector<Settings::Description> Settings::describe() const {
  SettingsData copy = *data_;
  std::vector<Description> all;
  std::vector<std::string> sections;  // in the order in which they appear first
  const auto section = [&](const Description& d) {
    const std::string head = d.key.substr(0, d.key.find('.'));
    const auto at = std::find(sections.begin(), sections.end(), head);
    if (at != sections.end()) return at - sections.begin();
    sections.push_back(head);
    return static_cast<std::ptrdiff_t>(sections.size()) - 1;
  };
  for (const kys::OptionList list = list_of(copy); const kys::Option& option : list.options()) {
    if (!option.settable) continue;
    all.push_back({option.key, option.text(), std::string(option.unit), std::string(option.meaning),
                   option.range_text()});
    section(all.back());
  }
  std::stable_sort(all.begin(), all.end(), [&](const Description& a, const Description& b) {
    return section(a) < section(b);
  });
  return all;
}

std::string Settings::to_yaml() const {
  std::ostringstream text;
  std::string section;
  for (const Description& d : describe()) {
    const std::size_t dot = d.key.find('.');
    const std::string head = d.key.substr(0, dot);
    if (head != section) {
      text << (section.empty() ? "" : "\n") << head << ":\n";
      section = head;
    }
    text << "  " << d.key.substr(dot + 1) << ": " << yaml_value(d.value) << "  # ";
    if (!d.unit.empty()) text << "[" << d.unit << "] ";
    text << d.meaning << (d.range.empty() ? "" : "; " + d.range) << "\n";
  }
  return text.str();
}

}  // namespace kys_slam
