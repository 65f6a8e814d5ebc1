#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>

namespace kys_slam {

/// Whether the bytes must be on the disk before the file takes its name. `kNo` still leaves either
/// the old or the complete new file after a crash of the program (not after a power cut); it is for
/// large numbers of files that can be made again.
enum class Durable { kYes, kNo };

/// Writes a whole file: a temporary file in the same folder, then a rename, so that readers (and a
/// killed program) see the old content or the new one and never a part.
/// \throws InputError "cannot write PATH: reason" (missing folder, no permission, disk full).
void write_file_atomic(const std::filesystem::path& path, std::span<const std::uint8_t> bytes,
                       Durable durable = Durable::kYes);
void write_file_atomic(const std::filesystem::path& path, std::string_view text,
                       Durable durable = Durable::kYes);

/// Makes the folder and its parents, checks that files can be made in it, and removes the temporary
/// files that a killed program left there.
/// \throws InputError naming the folder.
void make_output_folder(const std::filesystem::path& folder);

/// Before hours of work: whether `path` could be written now. Leaves nothing behind.
/// \throws InputError "cannot write PATH: reason"
void check_writable(const std::filesystem::path& path);

}  // namespace kys_slam
