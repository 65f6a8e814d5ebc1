#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace kys_slam {

/// Bytes this process may take: nine tenths of the least of the machine's memory, its control
/// group's and its own limit (ulimit -v). The environment variable KYS_MEMORY_MB (MB, 1e6 bytes)
/// says otherwise. Asked once: later changes of the environment do not count. \throws InputError
/// when KYS_MEMORY_MB is not a positive number.
std::size_t memory_limit();

/// For sizes that an input states, before the memory is asked for: a system may promise memory it
/// does not have, and end the process when it is used. Requests below 64 MB pass unlooked-at.
/// \throws InputError "<name>: needs ... MB" when this process would have more than memory_limit().
void check_memory(std::string_view name, std::size_t bytes);

/// For what grows while a program runs.
/// \throws InputError when `resident_mb` (MB) is more than memory_limit().
void check_memory_in_use(double resident_mb);

}  // namespace kys_slam
