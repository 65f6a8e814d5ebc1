// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <vector>

#include "optimization/front_kernels.h"
#include "util/page_array.h"

namespace kys_slam {

/// Lower triangle of a sparse symmetric matrix of 6x6 blocks: row r holds the blocks
/// [row_begin[r], row_begin[r + 1]), of increasing columns, the last one on the diagonal.
struct BlockPattern {
  std::vector<std::int32_t> row_begin{0};
  std::vector<std::int32_t> column;
  [[nodiscard]] std::int32_t rows() const {
    return static_cast<std::int32_t>(row_begin.size()) - 1;
  }
};

/// Multifrontal Cholesky factorisation (Duff and Reid 1983; Liu 1992) of such a matrix: rows in an
/// approximate minimum degree order, columns of (nearly) equal structure factorised together as a
/// dense front (front_kernels.h). Everything that depends on the pattern alone is done once. One
/// thread. The same input gives the same factor on every machine.
class BlockCholesky {
 public:
  using Block = Eigen::Matrix<double, 6, 6>;
  using Blocks = std::vector<Block, Eigen::aligned_allocator<Block>>;
  enum class Result : std::uint8_t { kDone, kNotPositive, kStopped };

  explicit BlockCholesky(const BlockPattern& pattern,
                         const front::Kernels& kernels = front::kernels());

  /// Factorises. Of diagonal blocks only the lower triangle is read.
  /// \param blocks in the order of the pattern
  /// \param stop checked every few million operations
  Result factorise(const Blocks& blocks, const std::atomic<bool>* stop = nullptr);
  /// The same, and blocks are released as soon as they have been used: together they take little
  /// more memory than the factor.
  /// \param blocks in the order of use_order()
  Result factorise(PageArray<Block>& blocks, const std::atomic<bool>* stop = nullptr);
  /// The order in which blocks are used: for every block of the pattern its place.
  [[nodiscard]] std::vector<std::int32_t> use_order() const;
  /// Gives the memory of the factor back until the next factorise().
  void release_factor() { factor_.release(0, factor_.size()); }
  /// x -> A^-1 x, after factorise() returned kDone.
  void solve(Eigen::VectorXd& x) const;

  /// Number of blocks of the factor, including those added by amalgamation.
  [[nodiscard]] std::size_t factor_blocks() const;

 private:
  /// A block of the matrix and its position in a front.
  struct Entry {
    std::int32_t block;
    std::int32_t row;  // in blocks
    std::int32_t col;
    bool transposed;
  };
  /// Columns [first, first + cols) of the factor and the rows `below` them.
  struct Front {
    std::int32_t first = 0;
    std::int32_t cols = 0;
    std::vector<std::int32_t> below;
    std::vector<Entry> entries;
    std::vector<std::int32_t> children;
    std::vector<std::int32_t> place;  // of the rows below in the parent's front
    std::int64_t L = 0;               // its part of factor_, a lower trapezoid, begins here
    [[nodiscard]] std::int32_t rows() const {
      return cols + static_cast<std::int32_t>(below.size());
    }
    /// Size of the update for the parent: the lower triangle of the rows below, by blocks.
    [[nodiscard]] std::size_t update_size() const {
      return below.size() * (below.size() + 1) / 2 * (front::kBlock * front::kBlock);
    }
  };

  using Structure = std::vector<std::vector<std::int32_t>>;
  void order(const BlockPattern& pattern);
  [[nodiscard]] Structure eliminate(const BlockPattern& pattern) const;
  void sort_by_tree(const Structure& structure);
  void make_fronts(const Structure& structure);
  void connect_fronts();
  void place_entries(const BlockPattern& pattern);
  void make_room();
  /// \param block_of the block of an entry, asked for in the order of use
  /// \param used is called when the blocks asked for so far are not needed any more
  template <typename BlockOf, typename Used>
  Result factorise(const BlockOf& block_of, const Used& used, const std::atomic<bool>* stop);
  template <typename BlockOf>
  void assemble(const Front& front, const BlockOf& block_of);
  Result eliminate_columns(const Front& front, const std::atomic<bool>* stop);
  void keep(const Front& front);

  const front::Kernels& kernels_;
  std::vector<std::int32_t> position_;  // of a row of the matrix in the order of elimination
  std::vector<Front> fronts_;           // children before parents
  PageArray<front::TileColumn> factor_;
  std::vector<front::TileColumn> work_;  // the front worked on
  std::vector<double> updates_;          // of fronts whose parent is not assembled yet, a stack
  std::size_t updates_end_ = 0;
};

}  // namespace kys_slam
