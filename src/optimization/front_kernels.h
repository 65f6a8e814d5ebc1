#pragma once

#include <cstdint>
#include <span>

/// The inner loops of block_cholesky.h over plain memory, compiled once per instruction set from
/// front_kernels.inc. Every element is computed as in the textbook, one product after the other by
/// increasing column, so every variant gives the same bytes, whatever it works on together.
namespace kys_slam::front {

inline constexpr int kBlock = 6;
inline constexpr int kTile = 24;  ///< rows

/// One column of a tile of 24 rows.
struct alignas(64) TileColumn {
  double row[kTile];
};

/// Where tile t begins in a lower triangle that is kept by tiles of rows: of tile t only the
/// columns up to its own diagonal are kept, and only the first `cols` of them.
// Always inlined: translation units of other instruction sets must not share a copy.
__attribute__((always_inline)) constexpr std::int64_t tile_begin(std::int64_t t,
                                                                 std::int64_t cols) {
  const std::int64_t whole = t < cols / kTile ? t : cols / kTile;  // tiles that end before `cols`
  return kTile * whole * (whole + 1) / 2 + (t - whole) * cols;
}

/// Sizes and places are in rows and columns, not blocks, but for those of `place`.
struct Kernels {
  const char* name;

  /// Eliminates the columns [at, at + width) of a front of `rows` rows and as many columns, in
  /// place: those columns become the factor's, what is right of them is updated. `at` is a multiple
  /// of kTile, `width` of kBlock. \return whether the matrix is positive definite as far as this
  bool (*eliminate)(TileColumn* front, int rows, int at, int width);

  /// Adds a lower triangle of `count` block rows, block by block and row by row, to a front: block
  /// (r, c) to (place[r], place[c]); places increase.
  void (*add_update)(const double* update, const std::int32_t* place, int count, TileColumn* front);

  /// The other way: what is right of the first `cols` columns of a front.
  void (*take_update)(const TileColumn* front, int rows, int cols, double* update);

  /// x -> L^-1 x: the first `cols` numbers become the solution, the others have their part taken
  /// off. x is as long as whole tiles.
  void (*solve_lower)(const TileColumn* factor, int rows, int cols, double* x);
  /// The first `cols` numbers of x become those of L^-T x, the others given.
  void (*solve_upper)(const TileColumn* factor, int rows, int cols, double* x);
};

/// The fastest variant this machine runs.
const Kernels& kernels();
/// All variants this machine runs, the plain one first.
std::span<const Kernels* const> available_kernels();

}  // namespace kys_slam::front
