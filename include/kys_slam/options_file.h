// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <filesystem>
#include <string>
#include <string_view>

namespace kys_slam {

/// Sets the option with this key. \throws InputError naming the unknown key (and the nearest known
/// one, or its present name after a renaming), or the value that is not of the option's type or not
/// in its range.
void set_option(const kys::OptionList& list, std::string_view key, std::string_view value);

/// Reads a YAML file of nested or dotted keys into the fields that the list points to. Fields
/// without a key in the file keep their values. \throws InputError as above, naming the file.
void load_option_list(const std::filesystem::path& file, const kys::OptionList& list);

/// The same for a struct with a `describe`, whose conditions are checked as well.
template <kys::Described Options>
void load_options_file(const std::filesystem::path& file, Options& options) {
  kys::OptionList list;
  describe(list, options);
  load_option_list(file, list);
  const std::string complaint = kys::complaint_about(options);
  if (!complaint.empty()) throw InputError(file.string() + ": " + complaint);
}

}  // namespace kys_slam
