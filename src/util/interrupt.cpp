#include "util/interrupt.h"

#include <fcntl.h>
#include <signal.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

namespace kys_slam {

namespace {

// A signal handler may do little more than write a byte: the other end is read by a thread.
std::array<int, 2> pipe_ends{-1, -1};

extern "C" void note_signal(int number) {
  const int saved = errno;
  signal(number, SIG_DFL);
  const char byte = 's';
  [[maybe_unused]] const auto written = write(pipe_ends[1], &byte, 1);
  errno = saved;
}

}  // namespace

InterruptGuard::InterruptGuard(std::function<void()> on_interrupt)
    : on_interrupt_(std::move(on_interrupt)) {
  if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) {
    throw std::system_error(errno, std::generic_category(), "no pipe for signals");
  }
  thread_ = std::thread([this] { wait(); });
  signal(SIGINT, note_signal);
  signal(SIGTERM, note_signal);
}

InterruptGuard::~InterruptGuard() {
  signal(SIGINT, SIG_DFL);
  signal(SIGTERM, SIG_DFL);
  const char byte = 'q';
  [[maybe_unused]] const auto written = write(pipe_ends[1], &byte, 1);
  thread_.join();
  close(pipe_ends[0]);
  close(pipe_ends[1]);
}

void InterruptGuard::wait() {
  while (true) {
    char byte = 0;
    const auto count = read(pipe_ends[0], &byte, 1);
    if (count < 0 && errno == EINTR) continue;
    if (count != 1 || byte == 'q') return;
    if (!requested_.exchange(true)) on_interrupt_();
  }
}

}  // namespace kys_slam
