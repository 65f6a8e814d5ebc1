// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/option_list.h>
#include <kys_slam/error.h>
#include <kys_slam/options_file.h>
#include <kys_slam/settings.h>

#include <algorithm>
#include <cctype>
#include <sstream>
#include <type_traits>
#include <variant>

#include "system/settings_data.h"

namespace kys_slam {

void describe(kys::OptionList& list, SegmentOptions& o) {
  list.add("control.segment_lag", o.lag, {0, 90}, "frames",
           "after its own at which a segmentation given late takes effect (not realtime)");
  list.add("control.segment_every", o.every, {0, 1000}, "frames",
           "between segmentations that are waited for (not realtime); 0: none is waited for");
  list.add("control.segment_timeout", o.timeout, {0, 1e6}, "s",
           "after which a wait for a segmentation ends and the run goes on without any");
  list.add("control.segment_memory", o.memory, {0, 60}, "s",
           "for which a segmentation is carried to later frames");
}

void describe(kys::OptionList& list, ControlOptions& o) {
  list.add("control.pipeline_delay", o.pipeline_delay, {0, 1000}, "frames",
           "after which the tracker receives the changes of the back end (pipelined)");
  list.add("control.blend_poses", o.blend_poses,
           "frames between two keyframes move with both; false: with the one before");
  list.add("control.stall_ms", o.stall_ms, {0, 60000}, "ms",
           "slept in every frame, for studies of time budgets");
  list.add("control.label_space", o.label_space, "label space of the prior files");
  describe(list, o.segments);
}

void describe(kys::OptionList& list, SettingsData& o) {
  describe(list, o.orb);
  describe(list, o.stereo);
  describe(list, o.tracking);
  describe(list, o.mapping);
  describe(list, o.rows);
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

Settings::Type type_of(const kys::Option& option) {
  using Type = Settings::Type;
  return std::visit(
      [](const auto& value) {
        using T = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_same_v<T, kys::OptionChoice>) {
          return Type::kChoice;
        } else {
          using Value = std::remove_pointer_t<T>;
          if constexpr (std::is_same_v<Value, bool>) return Type::kTruth;
          if constexpr (std::is_floating_point_v<Value>) return Type::kReal;
          return std::is_integral_v<Value> ? Type::kInteger : Type::kText;
        }
      },
      option.value);
}

Settings::Description description_of(const kys::Option& option) {
  Settings::Description d;
  d.key = option.key;
  d.value = option.text();
  d.unit = option.unit;
  d.meaning = option.meaning;
  d.range = option.range_text();
  d.type = type_of(option);
  d.least = option.range.least;
  d.most = option.range.most;
  if (const auto* choice = std::get_if<kys::OptionChoice>(&option.value)) {
    d.choices.assign(choice->names.begin(), choice->names.end());
  }
  return d;
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
  set_option(list_of(*data_), key, value);
}

std::string Settings::get(std::string_view key) const {
  for (const Description& d : describe()) {
    if (d.key == key) return d.value;
  }
  throw InputError("unknown setting '" + std::string(key) + "'");
}

void Settings::load(const std::filesystem::path& file) {
  load_option_list(file, list_of(*data_));
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
    all.push_back(description_of(option));
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
