// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace kys_slam {

/// The middle value, of an even number the lower one. Not empty.
double lower_median(std::vector<double> values);

/// Units per second (1, 1e3, 1e6, 1e9: s, ms, us, ns) in which increasing stamps can be the times
/// of a camera: intervals (median) of 1 ms to 10 s, in Unix time or less than a year after some
/// start. Of a single stamp: all that give such a time.
std::vector<std::int64_t> units_of_stamps(const std::vector<double>& stamps);

/// Name of such a unit.
const char* unit_name(std::int64_t per_second);

/// Times (s) of a text file, one row per image: the first column, or the second one behind a column
/// of consecutive numbers. A column that can be s is s, else ms, us or ns.
/// \throws InputError naming file and row: no increasing numbers, or column or unit cannot be
/// determined
std::vector<double> read_time_file(const std::filesystem::path& file);

}  // namespace kys_slam
