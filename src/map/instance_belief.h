// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace kys_slam {

/// Belief about one instance of the prior files, sent from the tracker to the map.
struct InstanceBelief {
  std::int32_t instance = -1;
  float p_static = 1;    ///< probability of being static
  float moving_for = 0;  ///< s, since p_static fell below 0.2; 0: it has not
  friend bool operator==(const InstanceBelief&, const InstanceBelief&) = default;
};

}  // namespace kys_slam
