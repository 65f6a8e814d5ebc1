#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace kys_slam {

struct SettingsData;

/// Every setting of the system, by dotted name ("orb.features"). Each has a default, so none needs
/// to be given; `describe` lists them all.
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

  /// Reads a YAML file of nested or dotted keys over the present values.
  /// \throws InputError naming the file and the unknown key (and the nearest known one) or the
  ///         value that is not of the setting's type or not in its range.
  void load(const std::filesystem::path& file);
  /// \throws InputError as above.
  void set(std::string_view key, std::string_view value);
  /// "KEY=VALUE". \throws InputError as above, or when it is no such thing.
  void assign(std::string_view assignment);
  [[nodiscard]] std::string get(std::string_view key) const;
  /// \throws InputError naming the first setting that makes no sense.
  void check() const;

  struct Description {
    std::string key;
    std::string value;  ///< present one
    std::string unit;   ///< "" for plain numbers
    std::string meaning;
    std::string range;  ///< "1 to 60000"; "" when the value is no number
  };
  [[nodiscard]] std::vector<Description> describe() const;
  /// The effective settings as an annotated YAML text that `load` reads back.
  [[nodiscard]] std::string to_yaml() const;

 private:
  friend struct PrivateAccess;
  std::unique_ptr<SettingsData> data_;
};

}  // namespace kys_slam
