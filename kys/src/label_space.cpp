// SPDX-License-Identifier: BSD-3-Clause
#include <kys/distance.h>
#include <kys/error.h>
#include <kys/label_space.h>

#include <unordered_set>
#include <utility>

namespace kys {

namespace {

constexpr float kLargestDistance = 10000;

void check_table(const std::vector<LabelClass>& classes, const std::vector<float>& table,
                 const std::string& origin) {
  const std::size_t n = classes.size();
  if (table.size() != n * n) {
    throw Error(origin + ": table has " + std::to_string(table.size()) + " entries, " +
                std::to_string(n) + " classes need " + std::to_string(n * n));
  }
  const auto pair = [&](std::size_t i, std::size_t j) {
    return "'" + classes[i].name + "' and '" + classes[j].name + "'";
  };
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      const float value = table[i * n + j];
      if (!(value >= 0.0f && value <= kLargestDistance)) {
        throw Error(origin + ": distance of " + pair(i, j) + " must be from 0 to 10000 bits, is " +
                    std::to_string(value));
      }
      if (value != table[j * n + i]) {
        throw Error(origin + ": table is not symmetric for " + pair(i, j));
      }
    }
    if (table[i * n + i] != 0.0f) {
      throw Error(origin + ": distance of '" + classes[i].name + "' to itself is not 0");
    }
  }
}

}  // namespace

LabelSpace::LabelSpace(std::string name, std::vector<LabelClass> classes, std::vector<float> table,
                       const std::string& origin)
    : name_(std::move(name)), classes_(std::move(classes)), table_(std::move(table)) {
  if (classes_.empty()) {
    throw Error(origin + ": no classes");
  }
  if (classes_.size() > 4096) {
    throw Error(origin + ": " + std::to_string(classes_.size()) + " classes, at most 4096 allowed");
  }
  std::unordered_set<std::string_view> names;
  for (std::size_t i = 0; i < classes_.size(); ++i) {
    const LabelClass& c = classes_[i];
    if (!index_of_id_.emplace(c.id, static_cast<std::uint16_t>(i)).second) {
      throw Error(origin + ": class id " + std::to_string(c.id) + " is there twice");
    }
    if (c.name.empty() || !names.insert(c.name).second) {
      throw Error(origin + ": class name '" + c.name + "' is empty or there twice");
    }
  }
  check_table(classes_, table_, origin);
}

const LabelClass& LabelSpace::at(std::uint16_t index) const {
  if (index >= classes_.size()) {
    throw Error("label space " + name_ + " has no class number " + std::to_string(index) +
                " (it has " + std::to_string(classes_.size()) + ")");
  }
  return classes_[index];
}

std::uint16_t LabelSpace::index_of(std::int32_t id) const {
  const auto found = index_of_id_.find(id);
  if (found == index_of_id_.end()) {
    throw Error("label space " + name_ + " has no class with id " + std::to_string(id));
  }
  return found->second;
}

std::uint16_t LabelSpace::index_of(std::string_view class_name) const {
  for (std::size_t i = 0; i < classes_.size(); ++i) {
    if (classes_[i].name == class_name) {
      return static_cast<std::uint16_t>(i);
    }
  }
  throw Error("label space " + name_ + " has no class '" + std::string(class_name) + "'");
}

float LabelSpace::distance(std::uint16_t a, std::uint16_t b) const {
  (void)at(a);
  (void)at(b);
  return table_[a * classes_.size() + b];
}

}  // namespace kys
