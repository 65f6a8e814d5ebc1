// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/drift.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "util/lanes.h"

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

/// out[x] = sum over i of kernel[|i|] in[x + i stride], for x = 0..n-1.
KYS_VECTOR_CLONES void convolve(const float* in, std::ptrdiff_t stride, int n,
                                const std::vector<float>& kernel, float* out) {
  constexpr int kBlock = 32;  // sums that stay in registers
  const auto radius = static_cast<std::ptrdiff_t>(kernel.size()) - 1;
  const auto sum_at = [&](int x) {
    float sum = kernel[0] * in[x];
    for (std::ptrdiff_t i = 1; i <= radius; ++i) {
      sum += kernel[static_cast<std::size_t>(i)] * (in[x - i * stride] + in[x + i * stride]);
    }
    return sum;
  };
  for (int x = 0; n < kBlock && x < n; ++x) out[x] = sum_at(x);
  for (int begin = 0; n >= kBlock && begin < n; begin += kBlock) {
    const int x = std::min(begin, n - kBlock);  // the last ones may be done twice
    float sum[kBlock];
    for (int k = 0; k < kBlock; ++k) sum[k] = kernel[0] * in[x + k];
    for (std::ptrdiff_t i = 1; i <= radius; ++i) {
      const float w = kernel[static_cast<std::size_t>(i)];
      const float* before = in + x - i * stride;
      const float* after = in + x + i * stride;
      for (int k = 0; k < kBlock; ++k) sum[k] += w * (before[k] + after[k]);
    }
    for (int k = 0; k < kBlock; ++k) out[x + k] = sum[k];
  }
}

/// Smooths every line of a field of cells along it.
void smooth_along(float* cells, int lines, int length, const std::vector<float>& kernel) {
  const int radius = static_cast<int>(kernel.size()) - 1;
  std::vector<float> padded(static_cast<std::size_t>(length + 2 * radius));
  float* middle = padded.data() + radius;
  for (int line = 0; line < lines; ++line) {
    float* row = cells + static_cast<std::ptrdiff_t>(line) * length;
    std::copy(row, row + length, middle);
    for (int i = 0; i < radius; ++i) {
      middle[-1 - i] = row[reflect(-1 - i, length)];
      middle[length + i] = row[reflect(length + i, length)];
    }
    convolve(middle, 1, length, kernel, row);
  }
}

/// Smooths a field of cells across its lines.
void smooth_across(float* cells, int lines, int length, const std::vector<float>& kernel) {
  const int radius = static_cast<int>(kernel.size()) - 1;
  const std::ptrdiff_t n = length;
  std::vector<float> padded(static_cast<std::size_t>((lines + 2 * radius) * n));
  for (int i = -radius; i < lines + radius; ++i) {
    const float* row = cells + reflect(i, lines) * n;
    std::copy(row, row + n, padded.data() + (i + radius) * n);
  }
  for (int line = 0; line < lines; ++line) {
    convolve(padded.data() + (line + radius) * n, n, length, kernel, cells + line * n);
  }
}

KYS_ALWAYS_INLINE void interpolate(float left, float right, const float* shares, float* out) {
  store_lanes(left + load_lanes(shares) * (right - left), out);
}

/// From the middle of the first cell to that of the last, linearly.
/// \param shares  of the right one of two cells, per column; whole lanes
/// \param out     may be written a lane's width beyond the last middle
KYS_VECTOR_CLONES void interpolate(const float* cells, int count, int cell,
                                   const std::vector<float>& shares, float* out) {
  const auto columns = static_cast<int>(shares.size());
  for (int c = 0; c + 1 < count; ++c, out += cell) {
    // Columns beyond the cell are overwritten by the next one.
    for (int k = 0; k < columns; k += kFloatLanes) {
      interpolate(cells[c], cells[c + 1], shares.data() + k, out + k);
    }
  }
}

}  // namespace

DriftField::DriftField(const BuilderOptions::Drift& options, int width, int height)
    : options_(options),
      width_(width),
      height_(height),
      cells_x_((width + options.cell - 1) / options.cell),
      cells_y_((height + options.cell - 1) / options.cell),
      stride_((cells_x_ + 1) * options.cell + kFloatLanes) {
  for (Field* field : {&u_, &v_, &mask_}) {
    field->columns.assign(static_cast<std::size_t>(width), 0.0F);
    field->cells.reserve(static_cast<std::size_t>(cells_x_) * static_cast<std::size_t>(cells_y_));
  }
}

int DriftField::rows_of_line(int line) const {
  return std::min(options_.cell, height_ - line * options_.cell);
}

bool DriftField::uses(int y) const {
  const int last = rows_of_line(y / options_.cell) - 1, row = y % options_.cell;
  return row == last / 4 || row == last - last / 4;
}

DriftField::Columns DriftField::columns(int y) {
  while (line_ < y / options_.cell) finish_line();
  return {u_.columns.data(), v_.columns.data(), mask_.columns.data()};
}

void DriftField::finish_line() {
  // Cells at the right and bottom edge are smaller: they count by their area.
  const int cell = options_.cell;
  const int rows = rows_of_line(line_), used = rows == 1 ? 1 : 2;
  const float scale = static_cast<float>(rows) / static_cast<float>(used * cell * cell);
  for (Field* field : {&u_, &v_, &mask_}) {
    for (int x = 0; x < width_; x += cell) {
      float sum = 0;
      for (int i = x; i < std::min(x + cell, width_); ++i) {
        sum += field->columns[static_cast<std::size_t>(i)];
      }
      field->cells.push_back(scale * sum);
    }
    std::fill(field->columns.begin(), field->columns.end(), 0.0F);
  }
  ++line_;
}

void DriftField::smooth() {
  while (line_ < cells_y_) finish_line();
  const int cell = options_.cell;
  // Averaging in cells and interpolating between them smooth as well: take their variance off.
  const double own = cell > 1 ? (cell * cell - 1) / 12.0 + cell * cell / 6.0 : 0.0;
  const double sigma = std::sqrt(std::max(0.25, options_.sigma * options_.sigma - own)) / cell;
  const std::vector<float> kernel = make_kernel(sigma);
  // The coverage is relative to what a mask of ones would give.
  const auto ones = [&](int cells, int pixels) {
    std::vector<float> line(static_cast<std::size_t>(cells), 1.0F);
    line.back() = static_cast<float>(pixels - (cells - 1) * cell) / static_cast<float>(cell);
    smooth_along(line.data(), 1, cells, kernel);
    return line;
  };
  const std::vector<float> columns = ones(cells_x_, width_), rows = ones(cells_y_, height_);
  for (Field* field : {&u_, &v_, &mask_}) {
    smooth_across(field->cells.data(), cells_y_, cells_x_, kernel);
    smooth_along(field->cells.data(), cells_y_, cells_x_, kernel);
  }
  std::size_t i = 0;
  for (const float row : rows) {
    for (const float column : columns) {
      const float mask = mask_.cells[i];
      const float inverse = mask > 1e-6F && options_.enabled ? 1.0F / mask : 0.0F;
      u_.cells[i] *= inverse;
      v_.cells[i] *= inverse;
      mask_.cells[i] = std::min(1.0F, mask / (row * column));
      ++i;
    }
  }
  for (Field* field : {&u_, &v_, &mask_}) widen(*field);
}

/// Values of a line of cells between their middles: linear there, constant outside the outermost.
void DriftField::widen(Field& field) const {
  const int cell = options_.cell;
  // Of the right one of two cells, for the columns between their middles.
  const int vectors = (cell + kFloatLanes - 1) / kFloatLanes;
  std::vector<float> shares(static_cast<std::size_t>(vectors * kFloatLanes));
  const int first = cell / 2;  // column, the first that lies between two middles
  const float offset = static_cast<float>(first) - 0.5F * static_cast<float>(cell - 1);
  for (std::size_t k = 0; k < shares.size(); ++k) {
    shares[k] = (static_cast<float>(k) + offset) / static_cast<float>(cell);
  }
  field.lines.resize(static_cast<std::size_t>(cells_y_) * static_cast<std::size_t>(stride_));
  for (int cy = 0; cy < cells_y_; ++cy) {
    const float* from = field.cells.data() + static_cast<std::ptrdiff_t>(cy) * cells_x_;
    float* to = field.lines.data() + static_cast<std::ptrdiff_t>(cy) * stride_;
    float* const end = to + stride_;
    std::fill(to, to + first, from[0]);
    to += first;
    interpolate(from, cells_x_, cell, shares, to);
    to += static_cast<std::ptrdiff_t>(cells_x_ - 1) * cell;
    std::fill(to, end, from[cells_x_ - 1]);
  }
}

DriftField::Row DriftField::row(int y) const {
  const float half = 0.5F * static_cast<float>(options_.cell - 1);
  const float row = std::clamp((static_cast<float>(y) - half) / static_cast<float>(options_.cell),
                               0.0F, static_cast<float>(cells_y_ - 1));
  const int upper = static_cast<int>(row);
  const int lower = std::min(upper + 1, cells_y_ - 1);
  const auto line = [this](const Field& field, int i) {
    return field.lines.data() + static_cast<std::ptrdiff_t>(i) * stride_;
  };
  return {line(u_, upper),
          line(v_, upper),
          line(mask_, upper),
          line(u_, lower),
          line(v_, lower),
          line(mask_, lower),
          row - static_cast<float>(upper)};
}

}  // namespace kys_slam
