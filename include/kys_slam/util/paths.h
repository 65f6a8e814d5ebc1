// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace kys_slam {

/// Queries of paths. When the answer is not known (no permission, a loop of links, a name that is
/// too long), they throw InputError "cannot read PATH: reason".

/// Whether `path` exists. Links are followed.
bool path_exists(const std::filesystem::path& path);
bool is_folder(const std::filesystem::path& path);
bool is_file(const std::filesystem::path& path);

/// The names in a folder, in any order, "." and ".." included.
std::vector<std::string> names_in_folder(const std::filesystem::path& folder);
/// The entries of a folder, sorted by name, without names that begin with '.'.
std::vector<std::filesystem::path> list_folder(const std::filesystem::path& folder);

/// Order of names by text, and of the whole numbers in them by value, so that 2 comes before 10:
/// below 0, 0, above 0. Digits after a decimal point are text.
int compare_names(std::string_view a, std::string_view b);
/// Sorts files of frames by compare_names() of their stems.
void sort_frames(std::vector<std::filesystem::path>& files);

/// Where a path leads that is a link, or a link to a link: what is written goes there, and the link
/// stays. Other paths as they are. What it leads to need not exist. \throws InputError for a loop
std::filesystem::path behind_links(const std::filesystem::path& path);

/// Whether both exist and are the same file or folder.
bool is_same_path(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace kys_slam
