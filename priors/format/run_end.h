#pragma once

#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

namespace kys_slam {

/// First x > begin at which a row of numbers differs from its value at begin, or the width.
template <typename T>
int run_end(const T* row, int begin, int width) {
  static_assert(std::is_unsigned_v<T> && sizeof(T) <= 4);
  // Eight bytes at a time.
  constexpr int kStep = 8 / sizeof(T);
  constexpr std::uint64_t kRepeat = ~std::uint64_t{0} / std::numeric_limits<T>::max();
  const std::uint64_t same = row[begin] * kRepeat;
  int x = begin + 1;
  for (std::uint64_t next = 0; x + kStep <= width; x += kStep) {
    std::memcpy(&next, row + x, sizeof next);
    if (next != same) break;
  }
  while (x < width && row[x] == row[begin]) ++x;
  return x;
}

}  // namespace kys_slam
