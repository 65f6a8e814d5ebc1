// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace kys_slam {

/// Bad input or bad usage: a missing, truncated, mismatched, non-finite or corrupt file, an unknown
/// setting, an unwritable folder. The message is one line that names the file (or setting) and what
/// is wrong with it. Programs print it and exit with status 2.
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace kys_slam
