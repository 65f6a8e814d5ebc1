// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/block_cholesky.h"

#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cstring>

namespace kys_slam {

namespace {

using front::kBlock;
using front::kTile;
using front::TileColumn;
constexpr int kPanel = 96;  // columns eliminated in one go

/// Columns with their parent's are one front as long as this share of it is zeros, at most; small
/// fronts in any case, as they cost more to handle than to compute.
constexpr double kMaxZeros = 0.15;
constexpr std::int32_t kSmall = 8;  // blocks

constexpr std::size_t kReleased = 4096;  // blocks released in one go, about 1 MB

std::int32_t tiles_of(std::int32_t rows) {
  return (rows + kTile - 1) / kTile;
}

std::int32_t parent_of(const std::vector<std::int32_t>& structure) {
  return structure.empty() ? -1 : structure.front();
}

}  // namespace

BlockCholesky::BlockCholesky(const BlockPattern& pattern, const front::Kernels& kernels)
    : kernels_(kernels) {
  order(pattern);
  sort_by_tree(eliminate(pattern));
  make_fronts(eliminate(pattern));
  connect_fronts();
  place_entries(pattern);
  make_room();
}

void BlockCholesky::order(const BlockPattern& pattern) {
  using Sparse = Eigen::SparseMatrix<double>;
  std::vector<Eigen::Triplet<double>> triplets;
  for (std::int32_t r = 0; r < pattern.rows(); ++r) {
    for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
      triplets.emplace_back(r, pattern.column[k], 1.0);
      if (pattern.column[k] != r) triplets.emplace_back(pattern.column[k], r, 1.0);
    }
  }
  Sparse whole(pattern.rows(), pattern.rows());
  whole.setFromTriplets(triplets.begin(), triplets.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(whole.selfadjointView<Eigen::Lower>(), order);
  position_.resize(static_cast<std::size_t>(pattern.rows()));
  for (std::int32_t k = 0; k < pattern.rows(); ++k) position_[order.indices()[k]] = k;
}

/// Rows of every column of the factor below its diagonal, increasing.
BlockCholesky::Structure BlockCholesky::eliminate(const BlockPattern& pattern) const {
  const std::size_t n = position_.size();
  Structure structure(n);
  for (std::int32_t r = 0; r < pattern.rows(); ++r) {
    for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
      const auto [low, high] = std::minmax(position_[r], position_[pattern.column[k]]);
      if (low != high) structure[low].push_back(high);
    }
  }
  for (std::size_t j = 0; j < n; ++j) {  // by now with all that children add
    auto& rows = structure[j];
    std::sort(rows.begin(), rows.end());
    rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
    if (rows.empty()) continue;
    auto& parent = structure[rows.front()];
    parent.insert(parent.end(), rows.begin() + 1, rows.end());
  }
  return structure;
}

/// Renumbers so that the columns of every subtree of the elimination tree are neighbours. The
/// factor stays as sparse.
void BlockCholesky::sort_by_tree(const Structure& structure) {
  const auto n = static_cast<std::int32_t>(structure.size());
  std::vector<std::int32_t> size(structure.size(), 1);  // of the subtree
  for (std::int32_t j = 0; j < n; ++j) {
    if (parent_of(structure[j]) >= 0) size[parent_of(structure[j])] += size[j];
  }
  // From the roots down: a subtree takes the last free places of its parent's.
  std::vector<std::int32_t> number(structure.size());
  std::vector<std::int32_t> free_end(structure.size());
  std::int32_t roots_end = n;
  for (std::int32_t j = n - 1; j >= 0; --j) {
    const std::int32_t parent = parent_of(structure[j]);
    std::int32_t& end = parent >= 0 ? free_end[parent] : roots_end;
    number[j] = end - 1;
    free_end[j] = end - 1;
    end -= size[j];
  }
  for (std::int32_t& p : position_) p = number[p];
}

/// Joins columns with their parent where that adds no or few zeros.
void BlockCholesky::make_fronts(const Structure& structure) {
  const auto n = static_cast<std::int32_t>(structure.size());
  std::vector<double> zeros;  // blocks of zeros in each front
  for (std::int32_t j = 0; j < n; ++j) {
    Front front;
    front.first = j;
    front.cols = 1;
    front.below = structure[j];
    double added = 0;
    while (!fronts_.empty() && !fronts_.back().below.empty() &&
           fronts_.back().below.front() < front.first + front.cols) {
      const Front& child = fronts_.back();
      // What the child's columns lack of the joint front.
      const double lacks = static_cast<double>(child.cols) *
                           (front.rows() - static_cast<double>(child.below.size()));
      const double cols = child.cols + front.cols;
      const double area = cols * (cols + 1) / 2 + cols * static_cast<double>(front.below.size());
      const double sum = added + zeros.back() + lacks;
      if (sum > kMaxZeros * area && child.cols + front.rows() > kSmall) break;
      front.first = child.first;
      front.cols += child.cols;
      added = sum;
      fronts_.pop_back();
      zeros.pop_back();
    }
    fronts_.push_back(std::move(front));
    zeros.push_back(added);
  }
}

void BlockCholesky::connect_fronts() {
  std::vector<std::int32_t> front_of(position_.size());
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    for (std::int32_t k = 0; k < fronts_[f].cols; ++k) {
      front_of[fronts_[f].first + k] = static_cast<std::int32_t>(f);
    }
  }
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    Front& front = fronts_[f];
    if (front.below.empty()) continue;
    Front& parent = fronts_[front_of[front.below.front()]];
    parent.children.push_back(static_cast<std::int32_t>(f));
    auto at = parent.below.begin();
    for (const std::int32_t row : front.below) {
      if (row < parent.first + parent.cols) {
        front.place.push_back(row - parent.first);
      } else {
        at = std::lower_bound(at, parent.below.end(), row);
        front.place.push_back(parent.cols + static_cast<std::int32_t>(at - parent.below.begin()));
      }
    }
  }
}

void BlockCholesky::place_entries(const BlockPattern& pattern) {
  std::vector<std::int32_t> front_of(position_.size());
  for (std::size_t f = 0; f < fronts_.size(); ++f) {
    std::fill_n(front_of.begin() + fronts_[f].first, fronts_[f].cols, static_cast<std::int32_t>(f));
  }
  for (std::int32_t r = 0; r < pattern.rows(); ++r) {
    for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
      const std::int32_t c = pattern.column[k];
      const auto [low, high] = std::minmax(position_[r], position_[c]);
      Front& front = fronts_[front_of[low]];
      std::int32_t row = high - front.first;
      if (row >= front.cols) {
        const auto at = std::lower_bound(front.below.begin(), front.below.end(), high);
        row = front.cols + static_cast<std::int32_t>(at - front.below.begin());
      }
      front.entries.push_back({k, row, low - front.first, position_[r] < position_[c]});
    }
  }
}

void BlockCholesky::make_room() {
  std::int64_t largest = 0;
  std::int64_t factor = 0;
  std::size_t updates = 0;
  std::size_t most = 0;
  for (Front& front : fronts_) {
    const std::int32_t rows = kBlock * front.rows();
    largest = std::max(largest, front::tile_begin(tiles_of(rows), rows));
    front.L = factor;
    factor += front::tile_begin(tiles_of(rows), kBlock * front.cols);
    for (const std::int32_t c : front.children) updates -= fronts_[c].update_size();
    updates += front.update_size();
    most = std::max(most, updates);
  }
  factor_ = PageArray<TileColumn>(static_cast<std::size_t>(factor));
  work_.resize(static_cast<std::size_t>(largest));
  updates_.resize(most);
}

/// The front in work_: blocks of the matrix and what its children pass on, which are the last ones
/// on the stack.
template <typename BlockOf>
void BlockCholesky::assemble(const Front& front, const BlockOf& block_of) {
  const std::int32_t rows = kBlock * front.rows();
  const std::int64_t size = front::tile_begin(tiles_of(rows), rows);
  std::memset(work_.data(), 0, static_cast<std::size_t>(size) * sizeof(TileColumn));
  for (const Entry& e : front.entries) {
    TileColumn* to =
        work_.data() + front::tile_begin(kBlock * e.row / kTile, rows) + kBlock * e.col;
    const std::int32_t row = kBlock * e.row % kTile;
    const Block& block = block_of(e);
    for (int c = 0; c < kBlock; ++c) {
      for (int r = 0; r < kBlock; ++r) {
        to[c].row[row + r] = e.transposed ? block(c, r) : block(r, c);
      }
    }
  }
  std::size_t size_of_updates = 0;
  for (const std::int32_t c : front.children) size_of_updates += fronts_[c].update_size();
  updates_end_ -= size_of_updates;
  const double* update = updates_.data() + updates_end_;
  for (const std::int32_t c : front.children) {
    const Front& child = fronts_[c];
    kernels_.add_update(update, child.place.data(), static_cast<std::int32_t>(child.place.size()),
                        work_.data());
    update += child.update_size();
  }
}

/// Eliminates the front's own columns, a panel at a time; what is left is the update of its parent.
BlockCholesky::Result BlockCholesky::eliminate_columns(const Front& front,
                                                       const std::atomic<bool>* stop) {
  const std::int32_t cols = kBlock * front.cols;
  const std::int32_t rows = kBlock * front.rows();
  for (std::int32_t at = 0; at < cols; at += kPanel) {
    if (stop != nullptr && stop->load(std::memory_order_relaxed)) return Result::kStopped;
    if (!kernels_.eliminate(work_.data(), rows, at, std::min(kPanel, cols - at))) {
      return Result::kNotPositive;
    }
  }
  return Result::kDone;
}

/// The factor's part of the front in work_, and its update on the stack.
void BlockCholesky::keep(const Front& front) {
  const std::int32_t cols = kBlock * front.cols;
  const std::int32_t rows = kBlock * front.rows();
  const std::int32_t tiles = tiles_of(rows);
  for (std::int32_t t = 0; t < tiles; ++t) {
    const TileColumn* from = work_.data() + front::tile_begin(t, rows);
    std::copy_n(from, std::min(kTile * (t + 1), cols),
                factor_.data() + front.L + front::tile_begin(t, cols));
  }
  kernels_.take_update(work_.data(), rows, cols, updates_.data() + updates_end_);
  updates_end_ += front.update_size();
}

std::vector<std::int32_t> BlockCholesky::use_order() const {
  std::size_t count = 0;
  for (const Front& front : fronts_) count += front.entries.size();
  std::vector<std::int32_t> place(count);
  std::int32_t next = 0;
  for (const Front& front : fronts_) {
    for (const Entry& e : front.entries) place[e.block] = next++;
  }
  return place;
}

BlockCholesky::Result BlockCholesky::factorise(const Blocks& blocks,
                                               const std::atomic<bool>* stop) {
  return factorise([&](const Entry& e) -> const Block& { return blocks[e.block]; }, [] {}, stop);
}

BlockCholesky::Result BlockCholesky::factorise(PageArray<Block>& blocks,
                                               const std::atomic<bool>* stop) {
  std::size_t used = 0;
  std::size_t released = 0;
  const auto next = [&](const Entry&) -> const Block& { return blocks.data()[used++]; };
  const auto release = [&] {
    if (used - released < kReleased) return;
    blocks.release(released, used);
    released = used;
  };
  const Result result = factorise(next, release, stop);
  blocks.release(0, blocks.size());
  return result;
}

template <typename BlockOf, typename Used>
BlockCholesky::Result BlockCholesky::factorise(const BlockOf& block_of, const Used& used,
                                               const std::atomic<bool>* stop) {
  updates_end_ = 0;
  for (const Front& front : fronts_) {
    assemble(front, block_of);
    used();
    const Result result = eliminate_columns(front, stop);
    if (result != Result::kDone) return result;
    keep(front);
  }
  return Result::kDone;
}

void BlockCholesky::solve(Eigen::VectorXd& x) const {
  Eigen::VectorXd y(x.size());
  for (std::size_t r = 0; r < position_.size(); ++r) {
    y.segment<6>(6 * position_[r]) = x.segment<6>(static_cast<Eigen::Index>(6 * r));
  }
  std::vector<double> part;  // of one front, whole tiles
  const auto own = [&](const Front& front) {
    part.assign(static_cast<std::size_t>(kTile * tiles_of(kBlock * front.rows())), 0.0);
    std::copy_n(y.data() + kBlock * front.first, kBlock * front.cols, part.data());
    return part.data() + kBlock * front.cols;  // the rows below
  };
  for (const Front& front : fronts_) {
    const double* below = own(front);
    kernels_.solve_lower(factor_.data() + front.L, kBlock * front.rows(), kBlock * front.cols,
                         part.data());
    std::copy_n(part.data(), kBlock * front.cols, y.data() + kBlock * front.first);
    for (const std::int32_t row : front.below) {
      for (int k = 0; k < kBlock; ++k) y[kBlock * row + k] += *below++;
    }
  }
  for (auto front = fronts_.rbegin(); front != fronts_.rend(); ++front) {
    double* below = own(*front);
    for (const std::int32_t row : front->below) {
      for (int k = 0; k < kBlock; ++k) *below++ = y[kBlock * row + k];
    }
    kernels_.solve_upper(factor_.data() + front->L, kBlock * front->rows(), kBlock * front->cols,
                         part.data());
    std::copy_n(part.data(), kBlock * front->cols, y.data() + kBlock * front->first);
  }
  for (std::size_t r = 0; r < position_.size(); ++r) {
    x.segment<6>(static_cast<Eigen::Index>(6 * r)) = y.segment<6>(6 * position_[r]);
  }
}

std::size_t BlockCholesky::factor_blocks() const {
  std::size_t blocks = 0;
  for (const Front& front : fronts_) {
    const auto cols = static_cast<std::size_t>(front.cols);
    blocks += cols * (cols + 1) / 2 + cols * front.below.size();
  }
  return blocks;
}

}  // namespace kys_slam
