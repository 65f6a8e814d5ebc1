// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/error.h>

#include <string>

namespace kys_slam {

/// Checks the values of any options struct that has a `describe`: every number against its range,
/// and the conditions that join several fields. Constructors call it for the options they are
/// given. \throws InputError naming the first invalid field and its range.
template <kys::Described Options>
void check_options(const Options& options) {
  const std::string complaint = kys::complaint_about(options);
  if (!complaint.empty()) throw InputError(complaint);
}

/// The same for a constructor's member initialiser list. \return `options`
template <kys::Described Options>
const Options& checked(const Options& options) {
  check_options(options);
  return options;
}

}  // namespace kys_slam
