// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace kys_slam {

struct SettingsData;

/// All settings of the system, by dotted key ("orb.features"). Each has a default. `describe` lists
/// them all with unit, range and meaning.
class Settings {
 public:
  Settings();  ///< defaults for driving (KITTI)
  ~Settings();
  Settings(const Settings& other);
  Settings& operator=(const Settings& other);
  Settings(Settings&&) noexcept;
  Settings& operator=(Settings&&) noexcept;

  /// Defaults for a drone or hand-held camera indoors (EuRoC).
  static Settings indoor();

  /// Reads a YAML file of nested or dotted keys. Keys that are not in the file keep their values.
  /// \throws InputError naming the file and the unknown key (and the nearest known one) or the
  ///         value that is not of the setting's type or not in its range.
  void load(const std::filesystem::path& file);
  /// \throws InputError as above.
  void set(std::string_view key, std::string_view value);
  /// Sets one setting from "KEY=VALUE". \throws InputError as above, or when there is no "=".
  void assign(std::string_view assignment);
  [[nodiscard]] std::string get(std::string_view key) const;
  /// \throws InputError naming the first invalid setting or contradiction, and the file that was
  ///         loaded if it was there already at its end.
  void check() const;

  enum class Type : std::uint8_t { kTruth, kInteger, kReal, kText, kChoice };
  struct Description {
    std::string key;
    std::string value;  ///< current value
    std::string unit;   ///< "" for plain numbers
    std::string meaning;
    std::string range;  ///< "1 to 60000"; "" when the value is not a number
    Type type = Type::kText;
    double least = 0, most = 0;        ///< of numbers, both allowed
    std::vector<std::string> choices;  ///< of kChoice
  };
  [[nodiscard]] std::vector<Description> describe() const;
  /// The effective settings as annotated YAML text, which `load` reads.
  [[nodiscard]] std::string to_yaml() const;

 private:
  friend struct PrivateAccess;
  std::unique_ptr<SettingsData> data_;
  std::string file_;           ///< loaded last
  std::string contradiction_;  ///< in the settings after it was loaded; "": none
};

}  // namespace kys_slam
