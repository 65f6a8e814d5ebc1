#include <fmt/format.h>
#include <kys/mode_options.h>
#include <kys/option_description.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/settings.h>
#include <kys_slam/util/nearest_name.h>
#include <kys_slam/util/parse_number.h>

#include <algorithm>
#include <cctype>
#include <optional>
#include <sstream>
#include <type_traits>

#include "io/yaml_file.h"
#include "kys/error.h"
#include "system/settings_data.h"

namespace kys_slam {

namespace {

std::string to_text(bool value) {
  return value ? "true" : "false";
}
std::string to_text(const std::string& value) {
  return value;
}
/// Numbers in their shortest form that is read back as the same number.
template <typename T>
std::string to_text(const T& value) {
  return fmt::format("{}", value);
}

std::string range_text(const SettingRange& range) {
  return to_text(range.least) + " to " + to_text(range.most);
}

template <typename T>
constexpr bool kIsNumber = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

/// Calls visit(key, reference to the value, range or nothing, unit, meaning) for every setting but
/// those of kys. A number without a range does not compile.
template <typename Visit>
struct WithRanges {
  Visit visit;

  template <typename T>
  void operator()(const char* key, T& value, SettingRange range, const char* unit,
                  const char* meaning) const {
    static_assert(kIsNumber<std::remove_const_t<T>>, "only numbers have ranges");
    visit(key, value, std::optional(range), unit, meaning);
  }
  template <typename T>
  void operator()(const char* key, T& value, const char* unit, const char* meaning) const {
    static_assert(!kIsNumber<std::remove_const_t<T>>, "every number needs a range");
    visit(key, value, std::optional<SettingRange>(), unit, meaning);
  }
};
template <typename Visit>
WithRanges(Visit) -> WithRanges<Visit>;  // for clang before 17

/// Throws InputError when `text` is not a value of the type, or out of range.
template <typename T>
void from_text(std::string_view key, std::string_view text,
               const std::optional<SettingRange>& range, T& value) {
  const auto fail = [&](const char* what) {
    throw InputError("setting " + std::string(key) + ": '" + std::string(text.substr(0, 80)) +
                     "' is not " + what);
  };
  if constexpr (std::is_same_v<T, std::string>) {
    constexpr std::size_t kLongest = 2000;  // bytes
    if (printable(text, kLongest) != text) fail("a line of at most 2000 printable characters");
    value = std::string(text);
  } else if constexpr (std::is_same_v<T, bool>) {
    if (text != "true" && text != "false") fail("true or false");
    value = text == "true";
  } else if constexpr (std::is_integral_v<T>) {
    const auto number = parse_int(text);
    if (!number || *number < 0 || *number > 1000000000) fail("a whole number from 0 to 1e9");
    value = static_cast<T>(*number);
  } else {
    const auto number = parse_double(text);
    if (!number) fail("a finite number");
    value = static_cast<T>(*number);
  }
  if constexpr (kIsNumber<T>) {
    if (!range) return;
    const auto number = static_cast<double>(value);
    if (!(number >= range->least && number <= range->most)) {
      fail(("from " + range_text(*range)).c_str());
    }
  }
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
Settings::Settings(const Settings& other) : data_(std::make_unique<SettingsData>(*other.data_)) {}
Settings& Settings::operator=(const Settings& other) {
  *data_ = *other.data_;
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
  bool found = false;
  visit_settings(*data_, WithRanges{[&](const char* name, auto& place, const auto& range,
                                        const char*, const char*) {
    if (key != name) return;
    found = true;
    auto parsed = place;
    from_text(key, value, range, parsed);
    place = parsed;
  }});
  if (found) return;
  std::vector<std::string> known;
  for (const Description& d : describe()) {
    if (d.key == key) found = true;
    known.push_back(d.key);
  }
  if (!found) {
    throw InputError("unknown setting '" + std::string(key) + "'" + did_you_mean(key, known));
  }
  try {
    kys::set_option(data_->kys, key, value);
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
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
}

void Settings::check() const {
  data_->orb.check();
  data_->stereo.check();
  data_->tracking.check();
  data_->objects.check();
  if (data_->mapping.bundle.max_keyframes < 1) {
    throw InputError("mapping.bundle_keyframes must be at least 1");
  }
  try {
    data_->kys.check();
    data_->belief.check();
  } catch (const kys::Error& error) {
    throw InputError(error.what());
  }
}

std::vector<Settings::Description> Settings::describe() const {
  std::vector<Description> all;
  visit_settings(
      std::as_const(*data_), WithRanges{[&](const char* key, const auto& value, const auto& range,
                                            const char* unit, const char* meaning) {
        all.push_back({key, to_text(value), unit, meaning, range ? range_text(*range) : ""});
      }});
  auto option = kys::option_descriptions().begin();  // in the order of the values
  for (const auto& [key, value] : kys::option_values(data_->kys)) {
    all.push_back({key, value, std::string(option->unit), std::string(option->meaning),
                   option->is_number() ? range_text({option->least, option->most}) : ""});
    ++option;
  }
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
