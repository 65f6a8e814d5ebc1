#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace kys_slam {

/// Questions about paths. What cannot be told (no permission, a loop of links, a name that is too
/// long) is InputError "cannot read PATH: reason", where std::filesystem has exceptions of its own.

/// Whether there is anything at `path`, links followed.
bool path_exists(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);
bool is_file(const std::filesystem::path& path);

/// The names in a folder, in any order, "." and ".." among them.
std::vector<std::string> names_in_folder(const std::filesystem::path& folder);
/// What is in a folder, sorted by name; names that begin with '.' are left out.
std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder);

/// Whether both are there and are one file or folder.
bool is_same_path(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace kys_slam
