#pragma once

#include <string_view>
#include <vector>

namespace kys {

/// What a user has to know of an option: its default is that of a default-constructed ModeOptions.
struct OptionDescription {
  std::string_view key;      ///< "kys.alpha"
  std::string_view unit;     ///< "bits", or "" for a plain number, a truth value or a name
  double least = 0;          ///< least and greatest value that ModeOptions::check() lets pass, both
  double most = 0;           ///< allowed; 0, 0: not a number
  std::string_view meaning;  ///< with the modes that use it

  [[nodiscard]] bool is_number() const { return most > least; }
};

/// Of all options, in the order of option_values().
const std::vector<OptionDescription>& option_descriptions();

}  // namespace kys
