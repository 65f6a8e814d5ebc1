// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "map/map.h"

namespace kys_slam {

/// Writes the map to a file that `load_map` reads back to an equal map (format: README.md of this
/// folder), atomically.
/// \param label_space label space of its priors, as named in the prior files; "" without priors
/// \throws InputError when the file cannot be written
/// \throws std::invalid_argument for a map with priors and no label space, or a name of more than
///   255 printable characters without blanks
void save_map(const Map& map, const std::filesystem::path& path, std::string_view label_space = "");

/// Reads a map. Everything in it counts as changed, so that the first change set taken from it
/// makes a full replica.
/// \param label_space of the priors of this run; if the map contains priors, it must equal the
/// label space of the file
/// \throws InputError, one line naming the file and what is wrong: missing, damaged, truncated,
///   newer, not a map, of another label space
Map load_map(const std::filesystem::path& path, std::string_view label_space = "");

/// Reads a map whatever the label space of its priors, for what needs no priors.
Map load_map_of_any_labels(const std::filesystem::path& path);

/// A map with what its file says beside: to be shown, or changed and written again.
struct StoredMap {
  Map map;
  std::string label_space;  ///< "": its priors have none, or there are none
  int version = 0;          ///< of the format
};
/// \throws InputError as load_map, whatever the label space
StoredMap load_stored_map(const std::filesystem::path& path);

/// The same in memory; `name` is used in messages.
std::vector<std::uint8_t> encode_map(const Map& map, std::string_view label_space = "");
/// Without a label space that of the map's priors can be any.
Map parse_map(std::vector<std::uint8_t> bytes, const std::string& name,
              std::optional<std::string_view> label_space = "");
StoredMap parse_stored_map(std::vector<std::uint8_t> bytes, const std::string& name,
                           std::optional<std::string_view> label_space);

}  // namespace kys_slam
