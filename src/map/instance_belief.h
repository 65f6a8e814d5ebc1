#pragma once

#include <cstdint>

namespace kys_slam {

/// What is believed of one thing of the prior files, as the tracker tells the map.
struct InstanceBelief {
  std::int32_t instance = -1;
  float p_static = 1;    ///< probability of standing still
  float moving_for = 0;  ///< s, for which it has been believed to move without a doubt
  friend bool operator==(const InstanceBelief&, const InstanceBelief&) = default;
};

}  // namespace kys_slam
