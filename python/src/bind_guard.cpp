// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/util/interrupt.h>

#include <memory>
#include <utility>

#include "bind.h"

namespace kys_slam {

namespace nb = nanobind;
using namespace nb::literals;

namespace {

/// Python's handlers of signals wait until a call of the library returns, this one does not.
class SignalGuard {
 public:
  explicit SignalGuard(nb::callable on_interrupt) : on_interrupt_(std::move(on_interrupt)) {
    guard_ = std::make_unique<InterruptGuard>([this] { call(); });
  }
  ~SignalGuard() { close(); }

  [[nodiscard]] bool requested() const { return requested_ || (guard_ && guard_->requested()); }
  void close() {
    if (!guard_) return;
    const nb::gil_scoped_release released;  // its thread may be waiting for it
    requested_ = guard_->requested();
    guard_.reset();
  }

 private:
  void call() const {
    const nb::gil_scoped_acquire acquired;
    try {
      on_interrupt_();
    } catch (nb::python_error& error) {
      error.discard_as_unraisable("interrupt");
    }
  }

  nb::callable on_interrupt_;
  std::unique_ptr<InterruptGuard> guard_;
  bool requested_ = false;
};

}  // namespace

void bind_guard(nb::module_& m) {
  nb::class_<SignalGuard>(m, "_InterruptGuard",
                          "Until close(), the first SIGINT, SIGTERM or SIGHUP calls `on_interrupt` "
                          "from a thread of its own, also while the library computes; a second "
                          "SIGINT or SIGTERM ends the program. Ignored signals stay ignored. Then "
                          "the handlers are the system's, not Python's. At most one at a time.")
      .def(nb::init<nb::callable>(), "on_interrupt"_a)
      .def_prop_ro("requested", &SignalGuard::requested, "whether a signal came")
      .def("close", &SignalGuard::close);
}

}  // namespace kys_slam
