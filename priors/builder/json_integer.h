#pragma once

#include <kys_slam/error.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>

namespace kys_slam {

/// A member that must be a whole number in the range of `Integer`. nlohmann::json converts between
/// number types without a check (undefined behaviour for a floating-point number out of range).
/// \param name of the file, for the message
/// \throws InputError; nlohmann::json::exception when there is no such member
template <typename Integer>
Integer integer_at(const nlohmann::json& object, const char* key, const std::string& name) {
  const nlohmann::json& value = object.at(key);
  using Limits = std::numeric_limits<Integer>;
  if (value.is_number_unsigned()) {
    const auto number = value.get<std::uint64_t>();
    if (number <= static_cast<std::uint64_t>(Limits::max())) return static_cast<Integer>(number);
  } else if (value.is_number_integer()) {  // negative
    const auto number = value.get<std::int64_t>();
    if (Limits::is_signed && number >= static_cast<std::int64_t>(Limits::min())) {
      return static_cast<Integer>(number);
    }
  }
  throw InputError(name + ": " + key + " is no whole number, or out of range: " + value.dump());
}

}  // namespace kys_slam
