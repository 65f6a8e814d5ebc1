#pragma once

namespace kys_slam {

/// From now on SIGINT and SIGTERM ask the program to stop (see interrupted()) instead of ending it.
/// A second signal of the same kind ends it at once.
void install_interrupt_handler();

/// A stop was asked for. Long loops look at it once per step, save what they have, and return.
bool interrupted();

/// Asks for a stop, or takes the request back (tests).
void set_interrupted(bool value);

}  // namespace kys_slam
