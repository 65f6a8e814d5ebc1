#pragma once

#include <stdexcept>
#include <string>

namespace kys {

/// Bad settings, a bad label space, or a prior that is not one. The message is one line that names
/// the file or setting and what is wrong with it. Thrown when something is loaded or made, never
/// when descriptors are compared.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace kys
