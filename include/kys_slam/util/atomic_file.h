// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>

namespace kys_slam {

/// Whether the bytes must be on the disk before the rename. With `kNo`, a crash of the program
/// leaves either the old or the complete new file; a power failure may not. For large numbers of
/// files that can be made again.
enum class Durable { kYes, kNo };

/// Writes a whole file: a temporary file in the same folder, then a rename. Readers see the old
/// content or the new one, never a part, also when the program is killed. A link stays; the file
/// it leads to is written. \throws InputError "cannot write PATH: reason" (missing folder, no
/// permission, disk full).
void write_file_atomic(const std::filesystem::path& path, std::span<const std::uint8_t> bytes,
                       Durable durable = Durable::kYes);
void write_file_atomic(const std::filesystem::path& path, std::string_view text,
                       Durable durable = Durable::kYes);

/// Creates the folder and its parents, checks that files can be created in it, and removes
/// temporary files of killed programs.
/// \throws InputError naming the folder.
void make_output_folder(const std::filesystem::path& folder);

/// Checks before a long run that `path` can be written. Leaves no file.
/// \throws InputError "cannot write PATH: reason"
void check_writable(const std::filesystem::path& path);

}  // namespace kys_slam
