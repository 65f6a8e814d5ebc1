// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_kernels.h"

#include <cstring>

namespace kys_slam::rig {
namespace {

using Pair = double __attribute__((vector_size(16), aligned(16)));

// At any multiple of 8 bytes. By copies: Clang takes what a function returns a reference to for
// aligned, whatever the attributes of its type say.
template <typename Vector>
KYS_ALWAYS_INLINE void load(const double* from, Vector& to) {
  std::memcpy(&to, from, sizeof to);
}
template <typename Vector>
KYS_ALWAYS_INLINE void store(const Vector& from, double* to) {
  std::memcpy(to, &from, sizeof from);
}

/// H -= a^T b of 3x6 matrices by rows.
KYS_ALWAYS_INLINE void subtract_product(const double* a, const double* b, std::ptrdiff_t stride,
                                        double* H) {
  Lanes top[3], upper;
  Pair bottom[3], lower;
  for (std::ptrdiff_t r = 0; r < 3; ++r) {
    load(a + 6 * r, top[r]);
    load(a + 6 * r + kLanes, bottom[r]);
  }
  for (std::ptrdiff_t c = 0; c < 6; ++c) {
    double* column = H + stride * c;
    load(column, upper);
    load(column + kLanes, lower);
    upper -= top[0] * b[c] + top[1] * b[c + 6] + top[2] * b[c + 12];
    lower -= bottom[0] * b[c] + bottom[1] * b[c + 6] + bottom[2] * b[c + 12];
    store(upper, column);
    store(lower, column + kLanes);
  }
}

}  // namespace

KYS_VECTOR_CLONES
void add_squares(const double* J, const double* weighted, std::size_t count, int lanes, double* H) {
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (std::ptrdiff_t first = 0; first < size; first += kLanes) {  // of four columns
    for (std::ptrdiff_t at = first; at < size; at += kLanes) {
      Lanes sums[kLanes];
      for (std::ptrdiff_t c = 0; c < kLanes; ++c) load(H + size * (first + c) + at, sums[c]);
      for (std::size_t row = 0; row < count; ++row) {
        const std::ptrdiff_t begin = static_cast<std::ptrdiff_t>(row) * size;
        Lanes j;
        load(J + begin + at, j);
        const double* factors = weighted + begin + first;
        for (std::ptrdiff_t c = 0; c < kLanes; ++c) sums[c] += j * factors[c];
      }
      for (std::ptrdiff_t c = 0; c < kLanes; ++c) store(sums[c], H + size * (first + c) + at);
    }
  }
}

KYS_VECTOR_CLONES
void add_rows(const double* rows, const double* factors, std::size_t count, int lanes, double* b) {
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (std::ptrdiff_t at = 0; at < size; at += kLanes) {
    Lanes sum, x;
    load(b + at, sum);
    for (std::size_t row = 0; row < count; ++row) {
      load(rows + static_cast<std::ptrdiff_t>(row) * size + at, x);
      sum += x * factors[row];
    }
    store(sum, b + at);
  }
}

KYS_VECTOR_CLONES
void add_products(const double* rows, const double* columns, std::size_t count, int lanes,
                  double* mixed) {
  constexpr std::ptrdiff_t kColumns = 6;
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (std::ptrdiff_t at = 0; at < size; at += kLanes) {
    Lanes sums[kColumns], j;
    for (std::ptrdiff_t c = 0; c < kColumns; ++c) load(mixed + size * c + at, sums[c]);
    for (std::size_t row = 0; row < count; ++row) {
      const auto number = static_cast<std::ptrdiff_t>(row);
      load(rows + number * size + at, j);
      for (std::ptrdiff_t c = 0; c < kColumns; ++c) sums[c] += j * columns[kColumns * number + c];
    }
    for (std::ptrdiff_t c = 0; c < kColumns; ++c) store(sums[c], mixed + size * c + at);
  }
}

KYS_VECTOR_CLONES
void subtract_pairs(const std::int32_t* place, const double* Z, std::size_t count,
                    std::ptrdiff_t stride, double* H) {
  constexpr std::size_t kSize = 18;
  for (std::size_t a = 0; a < count; ++a) {
    if (place[a] < 0) continue;
    for (std::size_t c = 0; c < count; ++c) {
      if (place[c] < 0 || place[c] > place[a]) continue;
      subtract_product(Z + kSize * a, Z + kSize * c, stride, H + place[a] + stride * place[c]);
    }
  }
}

}  // namespace kys_slam::rig
