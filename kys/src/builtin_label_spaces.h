// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

namespace kys::detail {

/// A label space that is part of the library: the contents of its two files.
struct BuiltinLabelSpace {
  std::string_view name;
  std::string_view classes;
  std::string_view table;
};

/// All of them, by name.
const std::vector<BuiltinLabelSpace>& builtin_label_space_files();

}  // namespace kys::detail
