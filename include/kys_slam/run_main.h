#pragma once

#include <exception>
#include <functional>
#include <string>
#include <string_view>

namespace kys_slam {

/// Exit statuses of all programs beside 0 (EX_SOFTWARE of sysexits.h for the last).
inline constexpr int kBadInput = 2;        ///< usage, input, or what the machine does not give
inline constexpr int kTrackingFailed = 3;  ///< fewer than half of the frames were tracked
inline constexpr int kDefect = 70;         ///< a defect of the program

/// What an exception comes to.
struct Failure {
  int status = kDefect;
  std::string message;  ///< one printable line
};

/// The outside's fault are InputError, kys::Error, what the operating system refuses (files,
/// threads) and memory that is not there; everything else is a defect, and the message says so.
Failure describe_failure(const std::exception_ptr& exception) noexcept;

/// `text` on one line that every terminal and every JSON reader takes: control characters and bytes
/// that are not UTF-8 become backslash escapes. Of more than `max_bytes` the middle is left out.
std::string printable(std::string_view text, std::size_t max_bytes = 2000);

/// Writes a line "program: message" to stderr.
void print_failure(std::string_view program, const Failure& failure) noexcept;

/// "KYS-SLAM 1.2.3".
const char* version_text();

/// Writes to stdout; what it does not take is reported at the end of run_main.
void print_text(std::string_view text) noexcept;

/// What every main() calls: runs `body` and returns its status. Whatever it throws becomes one line
/// on stderr and a status. From here on a pipe that nobody reads and a file beyond the size limit
/// are errors of writing and no longer end the process. What stdout did not take is reported,
/// unless it was a pipe whose reader left.
int run_main(std::string_view program, const std::function<int()>& body) noexcept;

}  // namespace kys_slam
