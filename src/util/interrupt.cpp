// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <kys_slam/util/interrupt.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

namespace kys_slam {

namespace {

constexpr std::array<int, 3> kSignals{SIGINT, SIGTERM, SIGHUP};

// A signal handler may do little more than write a byte: the other end is read by a thread.
std::array<int, 2> pipe_ends{-1, -1};

extern "C" void note_signal(int number) {
  const int saved = errno;
  // A closing terminal is signalled more than once: by the kernel and by the shell.
  signal(number, number == SIGHUP ? SIG_IGN : SIG_DFL);
  const char byte = 's';
  [[maybe_unused]] const auto written = write(pipe_ends[1], &byte, 1);
  errno = saved;
}

bool is_ignored(int number) {
  struct sigaction action {};
  return sigaction(number, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

void InterruptibleWait::wait_for(std::chrono::duration<double> duration) {
  std::unique_lock lock(mutex_);
  // Whole days are as good as for ever, and no clock overflows.
  constexpr std::chrono::duration<double> kMost(7 * 24 * 3600.0);
  changed_.wait_for(lock, std::min(duration, kMost), [&] { return interrupted_; });
}

void InterruptibleWait::interrupt() {
  {
    const std::lock_guard lock(mutex_);
    interrupted_ = true;
  }
  changed_.notify_all();
}

InterruptGuard::InterruptGuard(std::function<void()> on_interrupt)
    : on_interrupt_(std::move(on_interrupt)) {
  if (pipe2(pipe_ends.data(), O_CLOEXEC) != 0) {
    throw std::system_error(errno, std::generic_category(), "no pipe for signals");
  }
  try {
    thread_ = std::thread([this] { wait(); });
  } catch (...) {
    for (const int end : pipe_ends) close(end);
    throw;
  }
  for (const int number : kSignals) {
    if (!is_ignored(number)) signal(number, note_signal);
  }
}

InterruptGuard::~InterruptGuard() {
  for (const int number : kSignals) {
    if (!is_ignored(number)) signal(number, SIG_DFL);
  }
  close(pipe_ends[1]);  // the thread's read ends with nothing
  thread_.join();
  close(pipe_ends[0]);
}

void InterruptGuard::wait() {
  while (true) {
    char byte = 0;
    const auto count = read(pipe_ends[0], &byte, 1);
    if (count < 0 && errno == EINTR) continue;
    if (count != 1) return;
    if (requested_.exchange(true)) continue;
    pause_.interrupt();
    on_interrupt_();
  }
}

}  // namespace kys_slam
