// SPDX-License-Identifier: BSD-3-Clause
#include "priors/input/coco_categories.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "priors/input/json_input.h"

namespace kys_slam {

std::map<std::int64_t, std::uint16_t> coco_categories(const nlohmann::json& document,
                                                      const kys::LabelSpace& labels,
                                                      const std::string& name) {
  const std::vector<kys::LabelClass>& classes = labels.classes();
  std::map<std::int64_t, std::uint16_t> label_of;
  if (!document.contains("categories")) {
    for (std::size_t i = 0; i < classes.size(); ++i) {
      label_of[classes[i].id] = static_cast<std::uint16_t>(i);
    }
    return label_of;
  }
  std::map<std::int64_t, std::string> name_of;
  for (const nlohmann::json& category : document.at("categories")) {
    const auto called = category.at("name").get<std::string>();
    const auto id = integer_at<std::int64_t>(category, "id", name);
    if (name_of.emplace(id, called).first->second != called) {
      throw InputError(name + ": category " + std::to_string(id) + " is listed with two names");
    }
    const auto found = std::find_if(classes.begin(), classes.end(),
                                    [&](const kys::LabelClass& c) { return c.name == called; });
    if (found == classes.end()) continue;  // an error only when a segment uses it
    label_of[id] = static_cast<std::uint16_t>(found - classes.begin());
  }
  return label_of;
}

InputError unknown_category(std::int64_t category, const kys::LabelSpace& labels,
                            const std::string& file) {
  return InputError(file + ": category " + std::to_string(category) + " is not in label space " +
                    labels.name());
}

}  // namespace kys_slam
