#include "priors/builder/drift.h"

#include <algorithm>
#include <cmath>

#include "priors/builder/vectorize.h"

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
KYS_ROW_LOOP void smooth_lines(std::vector<float>& field, int lines, int length,
                               const std::vector<float>& kernel) {
  const int radius = static_cast<int>(kernel.size()) - 1;
  const auto n = static_cast<std::size_t>(length);
  std::vector<float> out(field.size(), 0.0F);
  for (int line = 0; line < lines; ++line) {
    float* to = out.data() + static_cast<std::size_t>(line) * n;
    const auto at = [&](int i) {
      return field.data() + static_cast<std::size_t>(reflect(line + i, lines)) * n;
    };
    const float* middle = at(0);
    for (std::size_t x = 0; x < n; ++x) to[x] = kernel[0] * middle[x];
    for (int i = 1; i <= radius; ++i) {
      const float w = kernel[static_cast<std::size_t>(i)];
      const float* before = at(-i);
      const float* after = at(i);
      for (std::size_t x = 0; x < n; ++x) to[x] += w * (before[x] + after[x]);
    }
  }
  field = std::move(out);
}

KYS_ROW_LOOP void mix_rows(const float* __restrict p, const float* __restrict q, float share,
                           std::size_t n, float* __restrict out) {
  for (std::size_t x = 0; x < n; ++x) out[x] = p[x] + share * (q[x] - p[x]);
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
  const float half = 0.5F * static_cast<float>(options.cell - 1);
  for (int x = 0; x < width; ++x) {
    const float at = std::clamp((static_cast<float>(x) - half) / static_cast<float>(options.cell),
                                0.0F, static_cast<float>(cells_x_ - 1));
    const int left = static_cast<int>(at);
    places_.push_back({left, std::min(left + 1, cells_x_ - 1), at - static_cast<float>(left)});
  }
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
  const float scale = 1.0F / static_cast<float>(cell * cell);
  for (std::vector<float>* field : {&u_, &v_, &mask_}) {
    for (float& value : *field) value *= scale;
  }
  // Averaging in cells and interpolating between them smooth as well: take their variance off.
  const double own = cell > 1 ? (cell * cell - 1) / 12.0 + cell * cell / 6.0 : 0.0;
  const double sigma = std::sqrt(std::max(0.25, options_.sigma * options_.sigma - own)) / cell;
  const std::vector<float> kernel = make_kernel(sigma);
  const auto lengths = [&](int cells, int pixels) {
    std::vector<float> length(static_cast<std::size_t>(cells), 1.0F);
    length.back() = static_cast<float>(pixels - (cells - 1) * cell) / static_cast<float>(cell);
    smooth_lines(length, cells, 1, kernel);
    return length;
  };
  const std::vector<float> columns = lengths(cells_x_, width_), rows = lengths(cells_y_, height_);
  for (std::vector<float>* field : {&u_, &v_, &mask_}) {
    smooth_lines(*field, cells_y_, cells_x_, kernel);
    *field = transpose(*field, cells_y_, cells_x_);
    smooth_lines(*field, cells_x_, cells_y_, kernel);
    *field = transpose(*field, cells_x_, cells_y_);
  }
  for (std::size_t i = 0; i < mask_.size(); ++i) {
    const float inverse = mask_[i] > 1e-6F && options_.enabled ? 1.0F / mask_[i] : 0.0F;
    u_[i] *= inverse;
    v_[i] *= inverse;
    const std::size_t cx = i % static_cast<std::size_t>(cells_x_);
    const std::size_t cy = i / static_cast<std::size_t>(cells_x_);
    mask_[i] = std::min(1.0F, mask_[i] / (rows[cy] * columns[cx]));
  }
  for (std::vector<float>* field : {&u_, &v_, &mask_}) widen(*field);
}

void DriftField::widen(std::vector<float>& cells) const {
  std::vector<float> wide(static_cast<std::size_t>(cells_y_) * static_cast<std::size_t>(width_));
  for (int cy = 0; cy < cells_y_; ++cy) {
    const float* from =
        cells.data() + static_cast<std::size_t>(cy) * static_cast<std::size_t>(cells_x_);
    float* to = wide.data() + static_cast<std::size_t>(cy) * static_cast<std::size_t>(width_);
    for (int x = 0; x < width_; ++x) {
      const Place& p = places_[static_cast<std::size_t>(x)];
      to[x] = from[p.left] + p.weight * (from[p.right] - from[p.left]);
    }
  }
  cells = std::move(wide);
}

void DriftField::row(int y, float* drift_u, float* drift_v, float* coverage) const {
  const float half = 0.5F * static_cast<float>(options_.cell - 1);
  const float row = std::clamp((static_cast<float>(y) - half) / static_cast<float>(options_.cell),
                               0.0F, static_cast<float>(cells_y_ - 1));
  const int upper = static_cast<int>(row);
  const int lower = std::min(upper + 1, cells_y_ - 1);
  const float b = row - static_cast<float>(upper);
  const auto n = static_cast<std::size_t>(width_);
  const auto mix = [&](const std::vector<float>& field, float* out) {
    mix_rows(field.data() + static_cast<std::size_t>(upper) * n,
             field.data() + static_cast<std::size_t>(lower) * n, b, n, out);
  };
  mix(u_, drift_u);
  mix(v_, drift_v);
  mix(mask_, coverage);
}

}  // namespace kys_slam
