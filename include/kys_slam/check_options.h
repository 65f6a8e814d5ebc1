#pragma once

#include <kys/option_list.h>
#include <kys_slam/error.h>

#include <string>

namespace kys_slam {

/// Checks the values of any options struct that has a `describe`: every number against its range,
/// and what several fields have to satisfy together. Classes check the options they are made with.
/// \throws InputError naming the first field whose value makes no sense, and its range.
template <kys::Described Options>
void check_options(const Options& options) {
  const std::string complaint = kys::complaint_about(options);
  if (!complaint.empty()) throw InputError(complaint);
}

/// The same in a constructor's list of members.
template <kys::Described Options>
const Options& checked(const Options& options) {
  check_options(options);
  return options;
}

}  // namespace kys_slam
