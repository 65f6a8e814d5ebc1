#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace kys_slam {

/// The middle one of the values, the upper of two. There has to be one; the order is lost.
template <typename T>
T median(std::vector<T>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace kys_slam
