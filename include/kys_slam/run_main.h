// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <functional>
#include <string>
#include <string_view>

namespace kys_slam {

/// Exit statuses of all programs other than 0. kDefect is EX_SOFTWARE of sysexits.h.
inline constexpr int kBadInput = 2;  ///< bad usage, bad input, or no memory, threads or disk space
inline constexpr int kTrackingFailed = 3;  ///< fewer than half of the frames were tracked
inline constexpr int kDefect = 70;         ///< a defect of the program

/// Exit status and message of an exception.
struct Failure {
  int status = kDefect;
  std::string message;  ///< one printable line
};

/// Status kBadInput for InputError, kys::Error, errors of the operating system (files, threads) and
/// lack of memory. Every other exception is a defect of the program, and the message says so.
Failure describe_failure(const std::exception_ptr& exception) noexcept;

/// `text` on one line that is valid on every terminal and in JSON: control characters and bytes
/// that are not UTF-8 become backslash escapes. A text longer than `max_bytes` loses its middle
/// part.
std::string printable(std::string_view text, std::size_t max_bytes = 2000);

/// The same as a field of a CSV file, which stays one field on one line: quoted where it has a
/// comma or a quote in it.
std::string csv_field(std::string_view text);

/// Writes a line "program: message" to stderr.
void print_failure(std::string_view program, const Failure& failure) noexcept;

/// "KYS-SLAM 1.2.3".
const char* version_text();

/// Writes to stdout. run_main reports write errors at its end.
void print_text(std::string_view text) noexcept;

/// Every main() calls it: runs `body` and returns its status. An exception becomes one line on
/// stderr and a status. A closed pipe and a file beyond the size limit become write errors; they do
/// not end the process. Write errors of stdout are reported, except for a closed pipe.
int run_main(std::string_view program, const std::function<int()>& body) noexcept;

}  // namespace kys_slam
