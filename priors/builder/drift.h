#pragma once

#include <vector>

#include "priors/builder/options.h"

namespace kys_slam {

/// The drift field and the coverage of Sec. 3.3: stuff-pixel residuals smoothed with a wide
/// Gaussian, divided by the identically smoothed stuff mask. Residuals are averaged in cells first,
/// the Gaussian runs over cells, and rows are interpolated bilinearly: at sigma 60 px and cells of
/// 8 px the field differs from the full-size one by well under a hundredth of the drift.
class DriftField {
 public:
  DriftField(const BuilderOptions::Drift& options, int width, int height);

  /// Adds pixels x0 <= x < x1 of a row: residuals (px), NaN where there is none.
  void add(int y, int x0, int x1, const float* residual_u, const float* residual_v);
  /// After the last add().
  void smooth();
  /// Drift (px) and coverage (0..1) of one row; each output is width long.
  void row(int y, float* drift_u, float* drift_v, float* coverage) const;

 private:
  void widen(std::vector<float>& cells) const;

  /// Between which cells a pixel of a row lies.
  struct Place {
    int left, right;
    float weight;
  };

  BuilderOptions::Drift options_;
  std::vector<Place> places_;
  int width_ = 0;
  int height_ = 0;
  int cells_x_ = 0;
  int cells_y_ = 0;
  std::vector<float> u_, v_, mask_;  ///< sums per cell; then smoothed fields, cell rows x width
};

}  // namespace kys_slam
