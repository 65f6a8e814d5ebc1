#include "priors/builder/drift.h"

#include <algorithm>
#include <cmath>

namespace kys_slam {
namespace {

/// Half of a symmetric Gaussian kernel, normalised.
std::vector<float> make_kernel(double sigma) {
  const int radius = std::max(1, static_cast<int>(std::ceil(4 * sigma)));
  std::vector<float> kernel(static_cast<std::size_t>(radius) + 1);
  double sum = 0;
  for (int i = 0; i <= radius; ++i)
    sum += (i == 0 ? 1 : 2) * std::exp(-0.5 * i * i / (sigma * sigma));
  for (int i = 0; i <= radius; ++i) {
    kernel[static_cast<std::size_t>(i)] =
        static_cast<float>(std::exp(-0.5 * i * i / (sigma * sigma)) / sum);
  }
  return kernel;
}

/// Index reflected into 0..n-1 at the outer pixel edges (d c b a | a b c d | d c b a).
int reflect(int i, int n) {
  const int period = 2 * n;
  i = ((i % period) + period) % period;
  return i < n ? i : period - 1 - i;
}

/// Rows of `lines` x `length` values smoothed along the first index (across lines), whole rows at a
/// time so that the compiler can vectorise.
void smooth_lines(std::vector<float>& field, int lines, int length,
                  const std::vector<float>& kernel) {
  const int radius = static_cast<int>(kernel.size()) - 1;
  const auto n = static_cast<std::size_t>(length);
  std::vector<float> out(field.size(), 0.0F);
  for (int line = 0; line < lines; ++line) {
    float* to = out.data() + static_cast<std::size_t>(line) * n;
    for (int i = -radius; i <= radius; ++i) {
      const float w = kernel[static_cast<std::size_t>(std::abs(i))];
      const float* from = field.data() + static_cast<std::size_t>(reflect(line + i, lines)) * n;
      for (std::size_t x = 0; x < n; ++x) to[x] += w * from[x];
    }
  }
  field = std::move(out);
}

std::vector<float> transpose(const std::vector<float>& in, int rows, int columns) {
  std::vector<float> out(in.size());
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      out[static_cast<std::size_t>(x) * static_cast<std::size_t>(rows) +
          static_cast<std::size_t>(y)] =
          in[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) +
             static_cast<std::size_t>(x)];
    }
  }
  return out;
}

}  // namespace

DriftField::DriftField(const BuilderOptions::Drift& options, int width, int height)
    : options_(options),
      width_(width),
      height_(height),
      cells_x_((width + options.cell - 1) / options.cell),
      cells_y_((height + options.cell - 1) / options.cell) {
  const auto count = static_cast<std::size_t>(cells_x_) * static_cast<std::size_t>(cells_y_);
  u_.assign(count, 0.0F);
  v_.assign(count, 0.0F);
  mask_.assign(count, 0.0F);
}

void DriftField::add(int y, int x0, int x1, const float* residual_u, const float* residual_v) {
  const int cell = options_.cell;
  const auto row = static_cast<std::size_t>(y / cell) * static_cast<std::size_t>(cells_x_);
  for (int x = x0; x < x1;) {
    const int end = std::min(x1, (x / cell + 1) * cell);
    const std::size_t at = row + static_cast<std::size_t>(x / cell);
    float sum_u = 0, sum_v = 0, count = 0;
    for (; x < end; ++x) {
      const bool valid = residual_u[x] == residual_u[x];
      sum_u += valid ? residual_u[x] : 0.0F;
      sum_v += valid ? residual_v[x] : 0.0F;
      count += valid ? 1.0F : 0.0F;
    }
    u_[at] += sum_u;
    v_[at] += sum_v;
    mask_[at] += count;
  }
}

void DriftField::smooth() {
  const int cell = options_.cell;
  // Cells at the right and bottom edge are smaller: they count by their area, and the coverage is
  // relative to what a mask of ones would give.
  std::vector<float> area(mask_.size(), 1.0F);
  const float scale = 1.0F / static_cast<float>(cell * cell);
  for (int cy = 0; cy < cells_y_; ++cy) {
    const int rows = std::min(cell, height_ - cy * cell);
    for (int cx = 0; cx < cells_x_; ++cx) {
      const int columns = std::min(cell, width_ - cx * cell);
      const std::size_t at = static_cast<std::size_t>(cy) * static_cast<std::size_t>(cells_x_) +
                             static_cast<std::size_t>(cx);
      u_[at] *= scale;
      v_[at] *= scale;
      mask_[at] *= scale;
      area[at] = static_cast<float>(rows * columns) * scale;
    }
  }
  // Averaging in cells and interpolating between them smooth as well: take their variance off.
  const double own = cell > 1 ? (cell * cell - 1) / 12.0 + cell * cell / 6.0 : 0.0;
  const double sigma = std::sqrt(std::max(0.25, options_.sigma * options_.sigma - own)) / cell;
  const std::vector<float> kernel = make_kernel(sigma);
  for (std::vector<float>* field : {&u_, &v_, &mask_, &area}) {
    smooth_lines(*field, cells_y_, cells_x_, kernel);
    *field = transpose(*field, cells_y_, cells_x_);
    smooth_lines(*field, cells_x_, cells_y_, kernel);
    *field = transpose(*field, cells_x_, cells_y_);
  }
  for (std::size_t i = 0; i < mask_.size(); ++i) {
    const float inverse = mask_[i] > 1e-6F && options_.enabled ? 1.0F / mask_[i] : 0.0F;
    u_[i] *= inverse;
    v_[i] *= inverse;
    mask_[i] = std::min(1.0F, mask_[i] / area[i]);
  }
}

void DriftField::interpolate(const std::vector<float>& cells, float row, float* out) const {
  const int cell = options_.cell;
  const float clamped = std::clamp(row, 0.0F, static_cast<float>(cells_y_ - 1));
  const int y0 = std::min(static_cast<int>(clamped), std::max(0, cells_y_ - 2));
  const int y1 = std::min(y0 + 1, cells_y_ - 1);
  const float b = clamped - static_cast<float>(y0);
  const float* upper =
      cells.data() + static_cast<std::size_t>(y0) * static_cast<std::size_t>(cells_x_);
  const float* lower =
      cells.data() + static_cast<std::size_t>(y1) * static_cast<std::size_t>(cells_x_);
  const auto at = [&](int cx) { return upper[cx] + b * (lower[cx] - upper[cx]); };
  // Between the centres of cells cx and cx+1 values are linear.
  const float inverse = 1.0F / static_cast<float>(cell);
  const float half = 0.5F * static_cast<float>(cell - 1);
  int x = 0;
  for (int cx = -1; cx < cells_x_ && x < width_; ++cx) {
    const float left = at(std::max(cx, 0)), right = at(std::min(cx + 1, cells_x_ - 1));
    const float centre = static_cast<float>(cx * cell) + half;
    const int end =
        std::min(width_, static_cast<int>(std::ceil(centre + static_cast<float>(cell))));
    const float slope = (right - left) * inverse;
    for (; x < end; ++x) out[x] = left + slope * (static_cast<float>(x) - centre);
  }
  for (; x < width_; ++x) out[x] = at(cells_x_ - 1);
}

void DriftField::row(int y, float* drift_u, float* drift_v, float* coverage) const {
  const float half = 0.5F * static_cast<float>(options_.cell - 1);
  const float row = (static_cast<float>(y) - half) / static_cast<float>(options_.cell);
  interpolate(u_, row, drift_u);
  interpolate(v_, row, drift_v);
  interpolate(mask_, row, coverage);
}

}  // namespace kys_slam
