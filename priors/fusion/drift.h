// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "priors/fusion/options.h"
#include "util/lanes.h"

namespace kys_slam {

/// The drift field and the coverage of Sec. 3.3: residuals of stuff pixels smoothed with a wide
/// Gaussian, divided by the stuff mask smoothed alike. Residuals are averaged in cells, over two
/// rows of each cell. The Gaussian runs over cells, and rows are interpolated bilinearly. At sigma
/// 60 px and cells of 8 px the field differs from the full-size one by less than a hundredth of the
/// drift. Cells of 1 px use every pixel.
class DriftField {
 public:
  DriftField(const BuilderOptions::Drift& options, int width, int height);

  /// Sums over the rows of one line of cells, one of each per column.
  struct Columns {
    float* u;      ///< px, residuals of the stuff pixels that have one
    float* v;      ///< px
    float* count;  ///< of these pixels
  };
  /// Whether the residuals of row y are needed: two rows of a cell, at equal distance above and
  /// below its centre.
  [[nodiscard]] bool uses(int y) const;
  /// The sums to which the residuals of a row are added. For rows with uses(y), in ascending order.
  Columns columns(int y);
  /// After the last row.
  void smooth();

  /// Drift and coverage along a row, between two lines of cells.
  struct Row {
    const float *upper_u, *upper_v, *upper_mask, *lower_u, *lower_v, *lower_mask;
    float share;  ///< of the lower one

    /// Drift (px) and coverage (0..1) at column x.
    KYS_ALWAYS_INLINE void at(int x, float& u, float& v, float& coverage) const {
      u = upper_u[x] + share * (lower_u[x] - upper_u[x]);
      v = upper_v[x] + share * (lower_v[x] - upper_v[x]);
      coverage = upper_mask[x] + share * (lower_mask[x] - upper_mask[x]);
    }
  };
  /// After smooth().
  [[nodiscard]] Row row(int y) const;

 private:
  /// One quantity: its sums by column of the present line of cells, its means by cell, and, once
  /// smoothed, its values by line of cells and pixel column.
  struct Field {
    std::vector<float> columns, cells, lines;
  };
  [[nodiscard]] int rows_of_line(int line) const;
  void finish_line();
  void widen(Field& field) const;

  BuilderOptions::Drift options_;
  int width_ = 0;
  int height_ = 0;
  int cells_x_ = 0;
  int cells_y_ = 0;
  int stride_ = 0;  ///< of the smoothed lines
  int line_ = 0;    ///< of cells, whose columns are being summed
  Field u_, v_, mask_;
};

}  // namespace kys_slam
