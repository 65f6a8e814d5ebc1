// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/error.h>
#include <kys_slam/util/memory_limit.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <string>

namespace kys_slam {

/// Parses the text of a JSON file. nlohmann::json copies and writes a document by recursion:
/// nesting without a limit uses up the stack. \param name of the file, for the message \throws
/// InputError when it is nested deeper than 64 or needs more memory than there is;
/// nlohmann::json::exception for a syntax error
inline nlohmann::json parse_json(const std::string& text, const std::string& name) {
  constexpr int kMaxDepth = 64;
  constexpr std::size_t kGrowth = 32;  // an empty object, three characters, takes so much of each
  check_memory(name, kGrowth * text.size());
  return nlohmann::json::parse(
      text, [&](int depth, nlohmann::json::parse_event_t, const nlohmann::json&) {
        if (depth > kMaxDepth) {
          throw InputError(name + ": is nested deeper than " + std::to_string(kMaxDepth));
        }
        return true;
      });
}

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
  const std::string found = value.is_number() ? value.dump() : value.type_name();
  throw InputError(name + ": " + key + " is no whole number, or out of range: " + found);
}

}  // namespace kys_slam
