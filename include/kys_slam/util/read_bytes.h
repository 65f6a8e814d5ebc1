// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace kys_slam {

/// The whole content of a regular file.
/// \throws InputError naming the file when it is missing, unreadable, not a regular file, or larger
///   than `max_bytes`.
std::vector<std::uint8_t> read_bytes(const std::filesystem::path& path,
                                     std::size_t max_bytes = std::size_t{1} << 30);
std::string read_text(const std::filesystem::path& path,
                      std::size_t max_bytes = std::size_t{1} << 30);

}  // namespace kys_slam
