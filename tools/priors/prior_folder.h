#pragma once

#include <filesystem>
#include <vector>

namespace kys_slam {

/// The file itself, or the prior files of a folder in order of name.
/// \throws InputError when there are none.
std::vector<std::filesystem::path> prior_files(const std::filesystem::path& input);

}  // namespace kys_slam
