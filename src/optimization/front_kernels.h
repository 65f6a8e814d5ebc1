// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>

/// The inner loops of block_cholesky.h, compiled once per instruction set from front_kernels.inc.
/// Every element is computed by the textbook formula, products in order of increasing column, so
/// every variant gives the same bytes for any blocking.
namespace kys_slam::front {

inline constexpr int kBlock = 6;
inline constexpr int kTile = 24;  ///< rows

/// One column of a tile of 24 rows.
struct alignas(64) TileColumn {
  double row[kTile];
};

/// Start of tile t in a lower triangle stored by tiles of rows. Of tile t only the columns up to
/// its own diagonal are stored, and at most the first `cols` of them.
// Always inlined: translation units of other instruction sets must not share a copy.
__attribute__((always_inline)) constexpr std::int64_t tile_begin(std::int64_t t,
                                                                 std::int64_t cols) {
  const std::int64_t whole = t < cols / kTile ? t : cols / kTile;  // tiles that end before `cols`
  return kTile * whole * (whole + 1) / 2 + (t - whole) * cols;
}

/// Sizes and positions are in rows and columns, except `place`, which is in blocks.
struct Kernels {
  const char* name;

  /// Eliminates the columns [at, at + width) of a front of `rows` rows and as many columns, in
  /// place: those columns become the factor's, the columns right of them are updated. `at` is a
  /// multiple of kTile, `width` of kBlock. \return whether the matrix is positive definite up to
  /// these columns
  bool (*eliminate)(TileColumn* front, int rows, int at, int width);

  /// Adds a lower triangle of `count` block rows, block by block and row by row, to a front: block
  /// (r, c) to (place[r], place[c]); places increase.
  void (*add_update)(const double* update, const std::int32_t* place, int count, TileColumn* front);

  /// The reverse: extracts the part right of the first `cols` columns of a front.
  void (*take_update)(const TileColumn* front, int rows, int cols, double* update);

  /// x -> L^-1 x: the first `cols` numbers become the solution, their contribution is subtracted
  /// from the others. The length of x is a multiple of kTile.
  void (*solve_lower)(const TileColumn* factor, int rows, int cols, double* x);
  /// The first `cols` numbers of x become those of L^-T x, the others given.
  void (*solve_upper)(const TileColumn* factor, int rows, int cols, double* x);
};

/// The fastest variant for this machine.
const Kernels& kernels();
/// All variants for this machine, the portable one first.
std::span<const Kernels* const> available_kernels();

}  // namespace kys_slam::front
