// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>

#include "util/lanes.h"

/// The inner loops of rig_bundle.cpp: rows of the Jacobian by the parameters of the rig, each
/// padded with zeros to `lanes` times four doubles. Compiled for several instruction sets, which
/// round alike.
namespace kys_slam::rig {

/// Numbers of a row of `parameters`.
constexpr int padded(int parameters) {
  return (parameters + kLanes - 1) / kLanes * kLanes;
}

/// H += sum of J^T weighted: the lower triangle, by columns of `lanes` times four.
/// \param J,weighted `count` rows
void add_squares(const double* J, const double* weighted, std::size_t count, int lanes, double* H);

/// b += sum of factor * row.
void add_rows(const double* rows, const double* factors, std::size_t count, int lanes, double* b);

/// mixed += sum of row * columns(row, .): six columns of `lanes` times four.
/// \param columns 6 per row
void add_products(const double* rows, const double* columns, std::size_t count, int lanes,
                  double* mixed);

/// H -= Z_a^T Z_c for every pair of poses of a point, lower triangle by columns of `stride`.
/// \param place of each pose among the unknowns; negative: fixed \param Z 3x6 by rows, each
void subtract_pairs(const std::int32_t* place, const double* Z, std::size_t count,
                    std::ptrdiff_t stride, double* H);

}  // namespace kys_slam::rig
