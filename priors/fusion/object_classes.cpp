// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/object_classes.h"

#include <kys/belief.h>

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>

namespace kys_slam {
namespace {

enum class Role { kNone, kPeople, kRidden, kVehicle };

struct Word {
  std::string_view name;
  Role role;
};
constexpr Word kWords[] = {
    {"person", Role::kPeople},     {"people", Role::kPeople},   {"rider", Role::kPeople},
    {"pedestrian", Role::kPeople}, {"child", Role::kPeople},    {"man", Role::kPeople},
    {"woman", Role::kPeople},      {"cyclist", Role::kPeople},  {"bicycle", Role::kRidden},
    {"bike", Role::kRidden},       {"minibike", Role::kRidden}, {"motorcycle", Role::kRidden},
    {"motorbike", Role::kRidden},  {"scooter", Role::kRidden},  {"horse", Role::kRidden},
    {"wheelchair", Role::kRidden}, {"car", Role::kVehicle},     {"van", Role::kVehicle},
    {"bus", Role::kVehicle},       {"truck", Role::kVehicle},   {"lorry", Role::kVehicle},
    {"train", Role::kVehicle},     {"tram", Role::kVehicle},    {"trailer", Role::kVehicle},
    {"caravan", Role::kVehicle},   {"vehicle", Role::kVehicle},
};

Role role_of(const kys::LabelClass& label_class) {
  if (kys::mobility(label_class) != kys::Mobility::kMobile) return Role::kNone;
  std::string name = label_class.name.substr(0, label_class.name.find(','));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto* word = std::find_if(std::begin(kWords), std::end(kWords),
                                  [&](const Word& w) { return w.name == name; });
  return word != std::end(kWords) ? word->role : Role::kNone;
}

bool is_ride(Role a, Role b) {
  return (a == Role::kPeople && b == Role::kRidden) || (a == Role::kRidden && b == Role::kPeople);
}

}  // namespace

ObjectClasses::ObjectClasses(const kys::LabelSpace& labels)
    : together_(labels.size() * labels.size(), false) {
  std::vector<Role> roles;
  for (const kys::LabelClass& c : labels.classes()) {
    moves_.push_back(kys::mobility(c) == kys::Mobility::kMobile);
    roles.push_back(role_of(c));
  }
  for (std::size_t a = 0; a < labels.size(); ++a) {
    for (std::size_t b = 0; b < labels.size(); ++b) {
      const bool same_role = roles[a] != Role::kNone && roles[a] == roles[b];
      const bool same_kind = (roles[a] == Role::kNone || roles[b] == Role::kNone) && moves_[a] &&
                             moves_[b] &&
                             labels.distance(static_cast<std::uint16_t>(a),
                                             static_cast<std::uint16_t>(b)) <= kSameKind;
      together_[a * labels.size() + b] = same_role || same_kind || is_ride(roles[a], roles[b]);
    }
  }
}

}  // namespace kys_slam
