#pragma once

#include <span>
#include <string>
#include <string_view>

namespace kys_slam {

/// Insertions, deletions, replacements and swaps of neighbours that turn one text into the other.
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The candidate nearest to `name` (the first of equally near ones), or "" when none is near enough
/// to be a typing error: at most a third of the name's letters, but two in any case.
std::string nearest_name(std::string_view name, std::span<const std::string> candidates);

/// "; did you mean 'x'?" or "", to end a message about an unknown name.
std::string did_you_mean(std::string_view name, std::span<const std::string> candidates);

}  // namespace kys_slam
