// SPDX-License-Identifier: BSD-3-Clause
#include "io/png_unfilter.h"

#include <cstdlib>
#include <cstring>

namespace kys_slam {
namespace {

std::uint8_t paeth(int left, int above, int above_left) {
  const int to_left = std::abs(above - above_left);
  const int to_above = std::abs(left - above_left);
  const int to_above_left = std::abs(left + above - 2 * above_left);
  // Written as selections, so that compilers emit conditional moves: the branches of the
  // specification are mispredicted about every other pixel.
  const int vertical = to_above <= to_above_left ? above : above_left;
  const bool take_left = (to_left <= to_above) & (to_left <= to_above_left);
  return static_cast<std::uint8_t>(take_left ? left : vertical);
}

// Bpp as a template parameter keeps the pixel on the left in registers.
template <std::size_t Bpp>
void unfilter_sub(const std::uint8_t* in, std::size_t size, std::uint8_t* out) {
  std::uint8_t left[Bpp] = {};
  for (std::size_t i = 0; i + Bpp <= size; i += Bpp) {
    for (std::size_t c = 0; c < Bpp; ++c) {
      left[c] = static_cast<std::uint8_t>(left[c] + in[i + c]);
      out[i + c] = left[c];
    }
  }
}

void unfilter_up(const std::uint8_t* in, const std::uint8_t* above, std::size_t size,
                 std::uint8_t* out) {
  for (std::size_t i = 0; i < size; ++i) out[i] = static_cast<std::uint8_t>(in[i] + above[i]);
}

template <std::size_t Bpp>
void unfilter_average(const std::uint8_t* in, const std::uint8_t* above, std::size_t size,
                      std::uint8_t* out) {
  std::uint8_t left[Bpp] = {};
  for (std::size_t i = 0; i + Bpp <= size; i += Bpp) {
    for (std::size_t c = 0; c < Bpp; ++c) {
      left[c] = static_cast<std::uint8_t>(in[i + c] + (left[c] + above[i + c]) / 2);
      out[i + c] = left[c];
    }
  }
}

template <std::size_t Bpp>
void unfilter_paeth(const std::uint8_t* in, const std::uint8_t* above, std::size_t size,
                    std::uint8_t* out) {
  std::uint8_t left[Bpp] = {};
  std::uint8_t above_left[Bpp] = {};
  for (std::size_t i = 0; i + Bpp <= size; i += Bpp) {
    for (std::size_t c = 0; c < Bpp; ++c) {
      const std::uint8_t b = above[i + c];
      left[c] = static_cast<std::uint8_t>(in[i + c] + paeth(left[c], b, above_left[c]));
      above_left[c] = b;
      out[i + c] = left[c];
    }
  }
}

/// The first row, whose row above counts as zero.
template <std::size_t Bpp>
void unfilter_first(int filter, const std::uint8_t* in, std::size_t size, std::uint8_t* out) {
  if (filter != 3) return unfilter_sub<Bpp>(in, size, out);  // Paeth of (left, 0, 0) is left
  for (std::size_t i = 0; i < size; ++i) {
    out[i] = static_cast<std::uint8_t>(in[i] + (i < Bpp ? 0 : out[i - Bpp] / 2));
  }
}

template <std::size_t Bpp>
bool unfilter(int filter, const std::uint8_t* in, const std::uint8_t* above, std::size_t size,
              std::uint8_t* out) {
  if (filter == 0 || (filter == 2 && above == nullptr)) {
    std::memcpy(out, in, size);
  } else if (filter == 1) {
    unfilter_sub<Bpp>(in, size, out);
  } else if (filter < 0 || filter > 4) {
    return false;
  } else if (above == nullptr) {
    unfilter_first<Bpp>(filter, in, size, out);
  } else if (filter == 2) {
    unfilter_up(in, above, size, out);
  } else if (filter == 3) {
    unfilter_average<Bpp>(in, above, size, out);
  } else {
    unfilter_paeth<Bpp>(in, above, size, out);
  }
  return true;
}

}  // namespace

bool png_unfilter_row(int filter, const std::uint8_t* in, const std::uint8_t* above,
                      std::size_t size, std::size_t bpp, std::uint8_t* out) {
  switch (bpp) {
    case 1:
      return unfilter<1>(filter, in, above, size, out);
    case 2:
      return unfilter<2>(filter, in, above, size, out);
    case 3:
      return unfilter<3>(filter, in, above, size, out);
    case 4:
      return unfilter<4>(filter, in, above, size, out);
    case 6:
      return unfilter<6>(filter, in, above, size, out);
    case 8:
      return unfilter<8>(filter, in, above, size, out);
    default:
      return false;
  }
}

}  // namespace kys_slam
