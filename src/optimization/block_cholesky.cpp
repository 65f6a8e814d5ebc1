#include "optimization/block_cholesky.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <numeric>

namespace kys_slam {

namespace {

constexpr Eigen::Index kPanel = 96;  // columns eliminated in one go

/// Columns with their parent's are one front as long as this share of it is zeros, at most; small
/// fronts in any case, as they cost more to handle than to compute.
constexpr double kMaxZeros = 0.15;
constexpr std::int32_t kSmall = 8;  // blocks

std::int32_t parent_of(const std::vector<std::int32_t>& structure) {
  return structure.empty() ? -1 : structure.front();
}

}  // namespace

BlockCholesky::BlockCholesky(const BlockPattern& pattern) {
  order(pattern);
  sort_by_tree(eliminate(pattern));
  make_fronts(eliminate(pattern));
  connect_fronts();
  place_entries(pattern);
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

/// The front in work_: blocks of the matrix and what its children pass on.
void BlockCholesky::assemble(const Front& front, const Blocks& blocks) {
  auto F = work_.topLeftCorner(6 * front.rows(), 6 * front.rows());
  F.setZero();
  for (const Entry& e : front.entries) {
    auto at = F.block<6, 6>(6 * e.row, 6 * e.col);
    if (e.transposed) {
      at = blocks[e.block].transpose();
    } else {
      at = blocks[e.block];
    }
  }
  for (const std::int32_t c : front.children) {
    Front& child = fronts_[c];
    const auto count = static_cast<std::int32_t>(child.place.size());
    for (std::int32_t col = 0; col < count; ++col) {
      for (std::int32_t row = col; row < count; ++row) {
        F.block<6, 6>(6 * child.place[row], 6 * child.place[col]) +=
            child.update.block<6, 6>(6 * row, 6 * col);
      }
    }
    child.update.resize(0, 0);
  }
}

/// Eliminates the front's own columns, a panel at a time; what is left is the update of its parent.
BlockCholesky::Result BlockCholesky::eliminate_columns(const Front& front,
                                                       const std::atomic<bool>* stop) {
  const Eigen::Index cols = 6 * front.cols;
  const Eigen::Index rows = 6 * front.rows();
  for (Eigen::Index at = 0; at < cols; at += kPanel) {
    if (stop != nullptr && stop->load(std::memory_order_relaxed)) return Result::kStopped;
    const Eigen::Index width = std::min(kPanel, cols - at);
    const Eigen::Index left = rows - at - width;
    Eigen::Ref<Eigen::MatrixXd> corner = work_.block(at, at, width, width);
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(corner);
    if (factor.info() != Eigen::Success || !corner.diagonal().allFinite()) {
      return Result::kNotPositive;
    }
    if (left == 0) continue;
    auto under = work_.block(at + width, at, left, width);
    corner.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(under);
    work_.block(at + width, at + width, left, left)
        .selfadjointView<Eigen::Lower>()
        .rankUpdate(under, -1.0);
  }
  return Result::kDone;
}

BlockCholesky::Result BlockCholesky::factorise(const Blocks& blocks,
                                               const std::atomic<bool>* stop) {
  Eigen::Index largest = 0;
  for (const Front& front : fronts_) largest = std::max<Eigen::Index>(largest, 6 * front.rows());
  work_.resize(largest, largest);
  for (Front& front : fronts_) {
    assemble(front, blocks);
    const Result result = eliminate_columns(front, stop);
    if (result != Result::kDone) return result;
    const Eigen::Index cols = 6 * front.cols;
    const Eigen::Index rows = 6 * front.rows();
    front.L = work_.topLeftCorner(rows, cols);
    front.update = work_.block(cols, cols, rows - cols, rows - cols);
  }
  return Result::kDone;
}

void BlockCholesky::solve(Eigen::VectorXd& x) const {
  Eigen::VectorXd y(x.size());
  for (std::size_t r = 0; r < position_.size(); ++r) {
    y.segment<6>(6 * position_[r]) = x.segment<6>(static_cast<Eigen::Index>(6 * r));
  }
  Eigen::VectorXd part;
  for (const Front& front : fronts_) {
    const Eigen::Index cols = 6 * front.cols;
    auto own = y.segment(6 * front.first, cols);
    front.L.topRows(cols).triangularView<Eigen::Lower>().solveInPlace(own);
    if (front.below.empty()) continue;
    part.noalias() = front.L.bottomRows(front.L.rows() - cols) * own;
    for (std::size_t k = 0; k < front.below.size(); ++k) {
      y.segment<6>(6 * front.below[k]) -= part.segment<6>(static_cast<Eigen::Index>(6 * k));
    }
  }
  for (auto front = fronts_.rbegin(); front != fronts_.rend(); ++front) {
    const Eigen::Index cols = 6 * front->cols;
    auto own = y.segment(6 * front->first, cols);
    part.resize(front->L.rows() - cols);
    for (std::size_t k = 0; k < front->below.size(); ++k) {
      part.segment<6>(static_cast<Eigen::Index>(6 * k)) = y.segment<6>(6 * front->below[k]);
    }
    own.noalias() -= front->L.bottomRows(part.size()).transpose() * part;
    front->L.topRows(cols).triangularView<Eigen::Lower>().transpose().solveInPlace(own);
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
