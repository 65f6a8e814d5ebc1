// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>
#include <kys_slam/error.h>

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace kys_slam {

/// Labels by category id of a COCO panoptic file: by the names of its `categories`, or without
/// these the ids of the label space. A category that is not in the label space has none.
/// \param name of the file, for the message
/// \throws InputError for two names of an id; nlohmann::json::exception for an incomplete category
std::map<std::int64_t, std::uint16_t> coco_categories(const nlohmann::json& document,
                                                      const kys::LabelSpace& labels,
                                                      const std::string& name);

/// For a category that has none, as `file` says.
InputError unknown_category(std::int64_t category, const kys::LabelSpace& labels,
                            const std::string& file);

}  // namespace kys_slam
