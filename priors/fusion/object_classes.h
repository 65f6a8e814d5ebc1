// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// Which classes the segments of one object can have: networks call parts of a van car, bus and
/// truck, and a cyclist is a rider on a bicycle. Classes that move by themselves have a role by
/// their name: people, what people ride, vehicles. Segments of one role can be one object, and so
/// can people and what they ride; other classes that move only if their semantic distance is at
/// most `kSameKind`. The distance alone would not do: motorcycle and car are nearer to each other
/// (97 bits) than person and rider (102) or car and bus (110), rider and bicycle are as far apart
/// (144) as person and truck.
class ObjectClasses {
 public:
  ObjectClasses() = default;  ///< no class moves
  explicit ObjectClasses(const kys::LabelSpace& labels);

  /// Whether the class moves by itself.
  [[nodiscard]] bool moves(std::uint16_t label) const {
    return label < moves_.size() && moves_[label];
  }
  /// Whether segments of both classes can be one object.
  [[nodiscard]] bool belong_together(std::uint16_t a, std::uint16_t b) const {
    return moves(a) && moves(b) && together_[a * moves_.size() + b];
  }
  /// By label; for MaskAssociator.
  [[nodiscard]] const std::vector<bool>& moving() const { return moves_; }

 private:
  static constexpr float kSameKind = 90;  // bits; car and truck have 86, half of all pairs 135
  std::vector<bool> moves_;
  std::vector<bool> together_;  // by pair
};

}  // namespace kys_slam
