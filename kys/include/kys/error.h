// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace kys {

/// Invalid settings, an invalid label space or an invalid prior. The message is one line that names
/// the file or setting and what is wrong with it. Thrown by loading and construction, never by
/// comparison of descriptors.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace kys
