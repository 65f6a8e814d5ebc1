// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys/error.h>
#include <kys_slam/error.h>
#include <kys_slam/run_main.h>
#include <poll.h>
#include <signal.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <new>
#include <system_error>

namespace kys_slam {

namespace {

/// Bytes of the well-formed UTF-8 character that `text` begins with, beyond ASCII; 0: none.
std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  std::size_t length = 0;
  if (first >= 0xC2 && first <= 0xDF) length = 2;
  if (first >= 0xE0 && first <= 0xEF) length = 3;
  if (first >= 0xF0 && first <= 0xF4) length = 4;
  if (length == 0 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0) != 0x80) return 0;
  }
  // Too long forms, surrogates, beyond U+10FFFF; C1 control characters (U+0080 to U+009F).
  const unsigned char second = byte(1);
  if (first == 0xE0 && second < 0xA0) return 0;
  if (first == 0xED && second > 0x9F) return 0;
  if (first == 0xF0 && second < 0x90) return 0;
  if (first == 0xF4 && second > 0x8F) return 0;
  if (first == 0xC2 && second < 0xA0) return 0;
  return length;
}

Failure outside(const std::string& message) {
  return {kBadInput, printable(message)};
}

Failure defect(const std::string& message) {
  return {kDefect,
          printable(message) + ": a defect of ours, please report it (" + version_text() + ")"};
}

Failure describe(const std::exception_ptr& exception) {
  try {
    std::rethrow_exception(exception);
  } catch (const InputError& error) {
    return outside(error.what());
  } catch (const kys::Error& error) {
    return outside(error.what());
  } catch (const std::filesystem::filesystem_error& error) {
    // what() says "filesystem error: cannot ...: reason [path] [path]" in words of the library.
    return outside(error.path1().string() + ": " + error.code().message());
  } catch (const std::bad_alloc&) {
    return {kBadInput, "out of memory"};
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::resource_unavailable_try_again) {
      return outside(std::string("cannot start a thread: ") + error.what());
    }
    return outside(error.what());
  } catch (const std::exception& error) {
    // OpenCV's own exception for memory that is not there.
    if (std::strstr(error.what(), "Insufficient memory") != nullptr) {
      return {kBadInput, "out of memory"};
    }
    // That of its threads, which is no std::system_error.
    if (std::strstr(error.what(), "pthread_create") != nullptr) {
      return outside(std::string("cannot start a thread: ") + error.what());
    }
    return defect(error.what());
  } catch (...) {
    return defect("unknown exception");
  }
}

/// For exceptions that leave a thread or a destructor.
[[noreturn]] void on_terminate() {
  const Failure failure = std::current_exception()
                              ? describe_failure(std::current_exception())
                              : Failure{kDefect, "the program ended itself: a defect of ours"};
  print_failure("kys_slam", failure);
  std::_Exit(failure.status);
}

/// Whether the other end of stdout has been closed.
bool reader_left() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & (POLLERR | POLLHUP)) != 0;
}

bool stdout_complete(std::string_view program) {
  errno = 0;
  const bool failed = std::fflush(stdout) != 0 || std::ferror(stdout) != 0;
  if (!failed || errno == EPIPE || reader_left()) return true;
  const char* reason = errno != 0 ? std::strerror(errno) : "not everything was taken";
  print_failure(program, outside(std::string("cannot write to standard output: ") + reason));
  return false;
}

/// A closed standard descriptor would become that of the next file or pipe, and messages would go
/// there.
void open_standard_descriptors() {
  for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; ++fd) {
    if (::fcntl(fd, F_GETFD) < 0) ::open("/dev/null", O_RDWR);  // takes the lowest that is free
  }
}

}  // namespace

const char* version_text() {
  return "KYS-SLAM " KYS_SLAM_VERSION;
}

std::string printable(std::string_view text, std::size_t max_bytes) {
  if (text.size() > max_bytes) {
    const std::size_t half = max_bytes / 2;
    return printable(text.substr(0, half), half) + "..." +
           printable(text.substr(text.size() - half), half);
  }
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    const auto byte = static_cast<unsigned char>(text[i]);
    std::size_t taken = byte >= 0x20 && byte < 0x7F ? 1 : 0;
    if (byte >= 0x80) taken = utf8_length(text.substr(i));
    if (taken > 0) {
      out += text.substr(i, taken);
    } else if (byte == '\n') {
      out += "\\n";
    } else if (byte == '\t') {
      out += "\\t";
    } else {
      std::array<char, 8> code{};
      std::snprintf(code.data(), code.size(), "\\x%02x", byte);
      out += code.data();
    }
    i += taken > 0 ? taken : 1;
  }
  return out;
}

std::string csv_field(std::string_view text) {
  std::string field = printable(text);
  if (field.find_first_of(",\"") == std::string::npos) return field;
  std::string quoted = "\"";
  for (const char c : field) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

Failure describe_failure(const std::exception_ptr& exception) noexcept {
  try {
    return describe(exception);
  } catch (...) {
    return {kBadInput, "out of memory"};  // short enough to need none
  }
}

void print_failure(std::string_view program, const Failure& failure) noexcept {
  std::fprintf(stderr, "%.*s: %s\n", static_cast<int>(program.size()), program.data(),
               failure.message.c_str());
}

void print_text(std::string_view text) noexcept {
  std::fwrite(text.data(), 1, text.size(), stdout);
}

int run_main(std::string_view program, const std::function<int()>& body) noexcept {
  open_standard_descriptors();
  std::set_terminate(on_terminate);
  ::signal(SIGPIPE, SIG_IGN);
  ::signal(SIGXFSZ, SIG_IGN);
  try {
    const int status = body();
    return stdout_complete(program) || status != 0 ? status : kBadInput;
  } catch (...) {
    print_failure(program, describe_failure(std::current_exception()));
    stdout_complete(program);
    return describe_failure(std::current_exception()).status;
  }
}

}  // namespace kys_slam
