// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace kys_slam {

/// A call in the wrong state, an error of the calling program: a frame fed after `finish`, a map
/// loaded after the first frame or after another one.
class LogicError : public std::logic_error {
 public:
  explicit LogicError(const std::string& message) : std::logic_error(message) {}
};

}  // namespace kys_slam
