// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace kys_slam {

/// Bytes this process may use: 0.9 times the least of the machine's memory, the limit of its
/// control group and its own limit (ulimit -v). The environment variable KYS_MEMORY_MB (MB, 1e6
/// bytes) overrides it. Read once: later changes of the environment have no effect. \throws
/// InputError when KYS_MEMORY_MB is not a positive number.
std::size_t memory_limit();

/// Checks a size stated by an input before memory is allocated: a system may grant memory it does
/// not have, and kill the process when it is used. Sizes below 64 MB are not checked.
/// \throws InputError "<name>: needs ... MB" when this process would have more than memory_limit().
void check_memory(std::string_view name, std::size_t bytes);

/// Checks the memory in use while a program runs.
/// \throws InputError when `resident_mb` (MB) is more than memory_limit().
void check_memory_in_use(double resident_mb);

}  // namespace kys_slam
