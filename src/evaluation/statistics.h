#pragma once

#include <cstddef>
#include <span>

namespace kys_slam {

/// Summary of a list of errors, in their unit. The standard deviation is the population's (divided
/// by n), the median of an even count is the mean of the two middle ones. All zero for no errors.
struct Statistics {
  std::size_t count = 0;
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0;
};

Statistics statistics(std::span<const double> errors);

}  // namespace kys_slam
