// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/parse_number.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>

namespace kys_slam {

/// Parses the command line. \return the exit status after --help and --version; nothing when the
/// program continues \throws InputError for bad usage
inline std::optional<int> parse_command_line(CLI::App& app, int argc, char** argv) {
  app.set_version_flag("--version", version_text());
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    throw InputError(std::string(error.what()) + "; see --help");
  }
  return std::nullopt;
}

/// An option with one value per occurrence, so that "--set KEY=VALUE SEQUENCE" does not consume the
/// sequence.
inline CLI::Option* one_at_a_time(CLI::Option* option) {
  return option->allow_extra_args(false);
}

/// A whole number from `least` to `most`. CLI11 alone replaces larger numbers by the largest of the
/// type.
inline CLI::Validator whole_number(std::int64_t least,
                                   std::int64_t most = std::numeric_limits<std::int64_t>::max()) {
  return CLI::Validator(
      [least, most](const std::string& text) -> std::string {
        const auto value = parse_int(text);
        if (value && *value >= least && *value <= most) return {};
        return "'" + text + "' is not a whole number from " + std::to_string(least) + " to " +
               std::to_string(most);
      },
      "INTEGER");
}

/// A finite number from `least` to `most`. CLI::Range accepts NaN.
inline CLI::Validator finite_range(double least, double most) {
  return CLI::Validator(
      [least, most](const std::string& text) -> std::string {
        double value = 0;
        if (CLI::detail::lexical_cast(text, value) && value >= least && value <= most) return {};
        return "'" + text + "' is not a number from " + CLI::detail::to_string(least) + " to " +
               CLI::detail::to_string(most);
      },
      "NUMBER");
}

}  // namespace kys_slam
