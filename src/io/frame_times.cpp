// SPDX-License-Identifier: BSD-3-Clause
#include "io/frame_times.h"

#include <fmt/format.h>
#include <kys_slam/error.h>
#include <kys_slam/util/parse_number.h>
#include <kys_slam/util/text_table.h>

#include <algorithm>
#include <array>
#include <optional>

namespace kys_slam {
namespace {

/// Whether the column is 0, 1, 2, .. from any number on, in all rows.
bool counts_rows(const TextTable& table) {
  std::optional<std::int64_t> before;
  for (const TextRow& row : table.rows()) {
    const auto number = parse_int(row.fields.front());
    if (!number || (before && *number != *before + 1)) return false;
    before = number;
  }
  return table.rows().size() > 1;
}

/// The numbers of a column, when all rows have one and they increase.
std::optional<std::vector<double>> increasing_column(const TextTable& table, std::size_t column) {
  std::vector<double> values;
  for (const TextRow& row : table.rows()) {
    const auto value = column < row.fields.size() ? parse_double(row.fields[column]) : std::nullopt;
    if (!value || (!values.empty() && *value <= values.back())) return std::nullopt;
    values.push_back(*value);
  }
  return values;
}

/// What to say where all rows look like the two halves of a number.
std::string decimal_commas(const TextTable& table) {
  const auto is_cut = [](const TextRow& row) {
    return row.fields.size() == 2 && parse_int(row.fields[0]) && parse_int(row.fields[1]);
  };
  const bool all = std::all_of(table.rows().begin(), table.rows().end(), is_cut);
  return all ? " (numbers have a decimal point here, no comma)" : "";
}

/// The column of time stamps.
std::vector<double> stamps_of(const TextTable& table) {
  const bool more = std::any_of(table.rows().begin(), table.rows().end(),
                                [](const TextRow& row) { return row.fields.size() > 1; });
  if (more && counts_rows(table)) {
    if (auto second = increasing_column(table, 1)) return *std::move(second);
    throw InputError(
        table.path().string() +
        ": the first column counts the images, and the second one is no time that "
        "increases (decimal points, no commas?); give a file with one time stamp per line");
  }
  std::vector<double> stamps;
  for (const TextRow& row : table.rows()) {
    stamps.push_back(table.number(row, 0));
    if (stamps.size() > 1 && stamps.back() <= stamps[stamps.size() - 2]) {
      table.fail(row, "time stamps do not increase" + decimal_commas(table) +
                          "; --rate in their place gives all frames the same distance");
    }
  }
  return stamps;
}

}  // namespace

double lower_median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<std::int64_t> units_of_stamps(const std::vector<double>& stamps) {
  // No camera takes 1000 pairs per second, and none that is tracked takes less than one in 10 s.
  constexpr double kShortest = 1e-3, kLongest = 10;  // s
  constexpr double kYear = 365 * 86400.0;            // s; stamps that count from some start
  constexpr double kFirst = 0.9e9, kLast = 4.2e9;    // s, Unix time of 1998 to 2103
  constexpr double kRounding = 1e-6;
  std::vector<double> apart;
  for (std::size_t i = 1; i < stamps.size(); ++i) apart.push_back(stamps[i] - stamps[i - 1]);
  std::vector<std::int64_t> units;
  for (const std::int64_t unit : {1LL, 1'000LL, 1'000'000LL, 1'000'000'000LL}) {
    const double begin = stamps.empty() ? 0 : stamps.front() / static_cast<double>(unit);
    if (begin > kYear && !(begin > kFirst && begin < kLast)) continue;
    if (!apart.empty()) {
      const double interval = lower_median(apart) / static_cast<double>(unit);
      if (interval < kShortest * (1 - kRounding) || interval > kLongest * (1 + kRounding)) continue;
    }
    units.push_back(unit);
  }
  return units;
}

const char* unit_name(std::int64_t per_second) {
  return per_second == 1 ? "s" : per_second == 1'000 ? "ms" : per_second == 1'000'000 ? "us" : "ns";
}

std::vector<double> read_time_file(const std::filesystem::path& file) {
  const TextTable table(file, TableStyle::kSpreadsheet);
  std::vector<double> stamps = stamps_of(table);
  if (stamps.size() < 2) return stamps;
  const std::vector<std::int64_t> units = units_of_stamps(stamps);
  if (!units.empty() && units.front() == 1) return stamps;
  if (units.size() == 1) {
    for (double& stamp : stamps) stamp /= static_cast<double>(units.front());
    return stamps;
  }
  std::string choice = units.empty() ? "no unit makes them times of a camera" : "they may be in";
  for (const std::int64_t unit : units) {
    choice += std::string(unit == units.front() ? " " : " or ") + unit_name(unit);
  }
  throw InputError(
      fmt::format("{}: time stamps that begin with {:.10g} and {:.10g} are not in s: {}; "
                  "give them in s",
                  file.string(), stamps[0], stamps[1], choice));
}

}  // namespace kys_slam
