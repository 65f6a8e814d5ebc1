// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/rig_kernels.h"

namespace kys_slam::rig {
namespace {

// At any multiple of 8 bytes.
using Loose __attribute__((vector_size(32), aligned(8), may_alias)) = double;
using LoosePair __attribute__((vector_size(16), aligned(8), may_alias)) = double;

KYS_ALWAYS_INLINE const Loose& lane(const double* row, int l) {
  return *reinterpret_cast<const Loose*>(row + std::ptrdiff_t{kLanes} * l);
}
KYS_ALWAYS_INLINE Loose& lane(double* row, int l) {
  return *reinterpret_cast<Loose*>(row + std::ptrdiff_t{kLanes} * l);
}
KYS_ALWAYS_INLINE const LoosePair& pair(const double* at) {
  return *reinterpret_cast<const LoosePair*>(at);
}
KYS_ALWAYS_INLINE LoosePair& pair(double* at) {
  return *reinterpret_cast<LoosePair*>(at);
}

/// H -= a^T b of 3x6 matrices by rows.
KYS_ALWAYS_INLINE void subtract_product(const double* a, const double* b, std::ptrdiff_t stride,
                                        double* H) {
  const Lanes top[] = {lane(a, 0), lane(a + 6, 0), lane(a + 12, 0)};
  const LoosePair bottom[] = {pair(a + 4), pair(a + 10), pair(a + 16)};
  for (std::ptrdiff_t c = 0; c < 6; ++c) {
    double* column = H + stride * c;
    lane(column, 0) -= top[0] * b[c] + top[1] * b[c + 6] + top[2] * b[c + 12];
    pair(column + 4) -= bottom[0] * b[c] + bottom[1] * b[c + 6] + bottom[2] * b[c + 12];
  }
}

}  // namespace

KYS_VECTOR_CLONES
void add_squares(const double* J, const double* weighted, std::size_t count, int lanes, double* H) {
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (int group = 0; group < lanes; ++group) {  // of four columns
    double* columns = H + size * kLanes * group;
    for (int l = group; l < lanes; ++l) {
      Lanes sums[] = {lane(columns, l), lane(columns + size, l), lane(columns + 2 * size, l),
                      lane(columns + 3 * size, l)};
      for (std::size_t row = 0; row < count; ++row) {
        const auto at = static_cast<std::ptrdiff_t>(row) * size;
        const Lanes j = lane(J + at, l);
        const double* factors = weighted + at + std::ptrdiff_t{kLanes} * group;
        for (int c = 0; c < kLanes; ++c) sums[c] += j * broadcast(factors[c]);
      }
      for (int c = 0; c < kLanes; ++c) lane(columns + size * c, l) = sums[c];
    }
  }
}

KYS_VECTOR_CLONES
void add_rows(const double* rows, const double* factors, std::size_t count, int lanes, double* b) {
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (int l = 0; l < lanes; ++l) {
    Lanes sum = lane(b, l);
    for (std::size_t row = 0; row < count; ++row) {
      sum += lane(rows + static_cast<std::ptrdiff_t>(row) * size, l) * broadcast(factors[row]);
    }
    lane(b, l) = sum;
  }
}

KYS_VECTOR_CLONES
void add_products(const double* rows, const double* columns, std::size_t count, int lanes,
                  double* mixed) {
  constexpr int kColumns = 6;
  const std::ptrdiff_t size = std::ptrdiff_t{kLanes} * lanes;
  for (int l = 0; l < lanes; ++l) {
    Lanes sums[kColumns];
    for (int c = 0; c < kColumns; ++c) sums[c] = lane(mixed + size * c, l);
    for (std::size_t row = 0; row < count; ++row) {
      const Lanes j = lane(rows + static_cast<std::ptrdiff_t>(row) * size, l);
      for (int c = 0; c < kColumns; ++c) sums[c] += j * broadcast(columns[c + kColumns * row]);
    }
    for (int c = 0; c < kColumns; ++c) lane(mixed + size * c, l) = sums[c];
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
