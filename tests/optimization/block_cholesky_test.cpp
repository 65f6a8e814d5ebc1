// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/block_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <set>

#include "optimization/schur_kernels.h"
#include "synthetic_scene.h"

namespace kys_slam::test {
namespace {

/// A random positive definite matrix with the given pairs of blocks off the diagonal.
struct System {
  BlockPattern pattern;
  BlockCholesky::Blocks blocks;
  Eigen::MatrixXd dense;
};

System make_system(int rows, const std::set<std::pair<int, int>>& pairs, std::uint64_t seed) {
  Random random(seed);
  System system;
  system.dense = Eigen::MatrixXd::Zero(6 * rows, 6 * rows);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c <= r; ++c) {
      if (c < r && !pairs.contains({r, c})) continue;
      BlockCholesky::Block block;
      for (double& x : block.reshaped()) x = random.uniform(-1, 1);
      if (c == r)
        block = (block * block.transpose() + rows * 6 * BlockCholesky::Block::Identity()).eval();
      system.pattern.column.push_back(c);
      system.blocks.push_back(block);
      system.dense.block<6, 6>(6 * r, 6 * c) = block;
      system.dense.block<6, 6>(6 * c, 6 * r) = block.transpose();
    }
    system.pattern.row_begin.push_back(static_cast<std::int32_t>(system.pattern.column.size()));
  }
  return system;
}

void expect_solves(const System& system, std::uint64_t seed) {
  Random random(seed);
  Eigen::VectorXd b(system.dense.rows());
  for (double& x : b) x = random.uniform(-1, 1);
  BlockCholesky cholesky(system.pattern);
  for (int again = 0; again < 2; ++again) {  // one analysis, several factorisations
    ASSERT_EQ(cholesky.factorise(system.blocks), BlockCholesky::Result::kDone);
    Eigen::VectorXd x = b;
    cholesky.solve(x);
    EXPECT_LT((system.dense * x - b).norm(), 1e-11 * b.norm());
    EXPECT_LT((x - system.dense.llt().solve(b)).norm(), 1e-11 * b.norm());
  }
}

TEST(BlockPlaces, AreThoseOfThePatternWithGapsAndInAnotherOrder) {
  std::set<std::pair<int, int>> pairs;
  for (int r = 1; r < 40; ++r) pairs.insert({r, r - 1});
  for (int r = 30; r < 40; ++r) {  // a loop: rows with gaps
    pairs.insert({r, r - 29});
    pairs.insert({r, r - 27});
  }
  const System system = make_system(40, pairs, 5);
  const std::vector<std::int32_t> order = BlockCholesky(system.pattern).use_order();
  const schur::BlockPlaces plain(system.pattern);
  const schur::BlockPlaces ordered(system.pattern, order);
  for (int r = 0; r < 40; ++r) {
    for (int k = system.pattern.row_begin[r]; k < system.pattern.row_begin[r + 1]; ++k) {
      EXPECT_EQ(plain(r, system.pattern.column[k]), k) << r;
      EXPECT_EQ(ordered(r, system.pattern.column[k]), order[k]) << r;
    }
  }
}

TEST(BlockCholesky, SolvesRandomPatterns) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Random random(seed);
    const int rows = 1 + static_cast<int>(random.below(40));
    std::set<std::pair<int, int>> pairs;
    for (std::size_t k = random.below(static_cast<std::size_t>(3 * rows)); k > 0; --k) {
      const int a = static_cast<int>(random.below(static_cast<std::size_t>(rows)));
      const int b = static_cast<int>(random.below(static_cast<std::size_t>(rows)));
      if (a != b) pairs.insert({std::max(a, b), std::min(a, b)});
    }
    expect_solves(make_system(rows, pairs, seed), seed);
  }
}

TEST(BlockCholesky, SolvesChainsLoopsAndFullMatrices) {
  std::set<std::pair<int, int>> chain;
  for (int r = 1; r < 120; ++r) {
    for (int c = std::max(0, r - 5); c < r; ++c) chain.insert({r, c});
  }
  expect_solves(make_system(120, chain, 1), 1);
  auto loop = chain;
  for (int r = 90; r < 120; ++r) loop.insert({r, r - 90});
  expect_solves(make_system(120, loop, 2), 2);
  std::set<std::pair<int, int>> full;
  for (int r = 0; r < 50; ++r) {
    for (int c = 0; c < r; ++c) full.insert({r, c});
  }
  expect_solves(make_system(50, full, 3), 3);  // several panels in one front
  expect_solves(make_system(7, {}, 4), 4);
}

TEST(BlockCholesky, AChainFillsHardlyIn) {
  std::set<std::pair<int, int>> chain;
  for (int r = 1; r < 500; ++r) {
    for (int c = std::max(0, r - 4); c < r; ++c) chain.insert({r, c});
  }
  const System system = make_system(500, chain, 1);
  EXPECT_LT(BlockCholesky(system.pattern).factor_blocks(), 2 * system.blocks.size());
}

TEST(BlockCholesky, ReportsWhatIsNotPositiveAndGoesOnAfterwards) {
  System system = make_system(20, {{3, 1}, {9, 3}, {19, 0}}, 5);
  BlockCholesky cholesky(system.pattern);
  auto bad = system.blocks;
  bad[static_cast<std::size_t>(system.pattern.row_begin[10] - 1)](2, 2) = -1;
  EXPECT_EQ(cholesky.factorise(bad), BlockCholesky::Result::kNotPositive);
  bad = system.blocks;
  bad[0](1, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(cholesky.factorise(bad), BlockCholesky::Result::kNotPositive);
  const std::atomic<bool> stop{true};
  EXPECT_EQ(cholesky.factorise(system.blocks, &stop), BlockCholesky::Result::kStopped);
  ASSERT_EQ(cholesky.factorise(system.blocks), BlockCholesky::Result::kDone);
  Eigen::VectorXd x = Eigen::VectorXd::Ones(120);
  cholesky.solve(x);
  EXPECT_LT((system.dense * x - Eigen::VectorXd::Ones(120)).norm(), 1e-11);
}

TEST(BlockCholesky, BlocksThatAreReleasedOnceUsedGiveTheSameFactor) {
  std::set<std::pair<int, int>> pairs;
  Random random(8);
  for (int r = 1; r < 900; ++r) {  // more blocks than are released in one go
    for (int c = std::max(0, r - 8); c < r; ++c) pairs.insert({r, c});
    if (r > 20) pairs.insert({r, static_cast<int>(random.below(static_cast<std::uint64_t>(r)))});
  }
  const System system = make_system(900, pairs, 6);
  ASSERT_GT(system.blocks.size(), 8000u);
  Eigen::VectorXd expected = Eigen::VectorXd::Ones(5400);
  BlockCholesky kept(system.pattern);
  ASSERT_EQ(kept.factorise(system.blocks), BlockCholesky::Result::kDone);
  kept.solve(expected);

  BlockCholesky released(system.pattern);
  const std::vector<std::int32_t> place = released.use_order();
  std::vector<std::int32_t> sorted = place;
  std::ranges::sort(sorted);
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    ASSERT_EQ(sorted[k], static_cast<std::int32_t>(k)) << "every place once";
  }
  PageArray<BlockCholesky::Block> blocks(system.blocks.size());
  for (int again = 0; again < 3; ++again) {
    for (std::size_t k = 0; k < place.size(); ++k) blocks.data()[place[k]] = system.blocks[k];
    ASSERT_EQ(released.factorise(blocks), BlockCholesky::Result::kDone);
    Eigen::VectorXd x = Eigen::VectorXd::Ones(5400);
    released.solve(x);
    EXPECT_EQ(x, expected);
    released.release_factor();
  }
}

TEST(BlockCholesky, SameNumbersSameFactor) {
  const System system = make_system(30, {{3, 1}, {9, 3}, {19, 0}, {29, 9}, {28, 3}}, 5);
  Eigen::VectorXd x = Eigen::VectorXd::Ones(180);
  Eigen::VectorXd y = x;
  BlockCholesky a(system.pattern);
  BlockCholesky b(system.pattern);
  a.factorise(system.blocks);
  b.factorise(system.blocks);
  a.solve(x);
  b.solve(y);
  EXPECT_EQ(x, y);
}

/// The first columns of a matrix eliminated one by one, and what is left of the others.
Eigen::MatrixXd eliminate_as_in_the_textbook(Eigen::MatrixXd A, int cols) {
  for (int k = 0; k < cols; ++k) {
    A(k, k) = std::sqrt(A(k, k));
    const double inverse = 1.0 / A(k, k);
    for (int r = k + 1; r < A.rows(); ++r) A(r, k) *= inverse;
    for (int c = k + 1; c < A.cols(); ++c) {
      for (int r = c; r < A.rows(); ++r) A(r, c) -= A(r, k) * A(c, k);
    }
  }
  return A;
}

TEST(FrontKernels, EveryVariantIsTheTextbookToTheLastBit) {
  // One column block to several panels; rows that fill their tiles, and rows that do not.
  const std::vector<std::pair<int, int>> sizes = {
      {6, 6}, {24, 24}, {30, 6}, {54, 30}, {96, 96}, {150, 102}, {132, 24}, {234, 216}, {300, 198}};
  for (const auto& [rows, cols] : sizes) {
    Random random(static_cast<std::uint64_t>(rows));
    Eigen::MatrixXd A(rows, rows);
    for (double& x : A.reshaped()) x = random.uniform(-1, 1);
    A = (A * A.transpose() + 0.1 * Eigen::MatrixXd::Identity(rows, rows)).eval();
    const Eigen::MatrixXd expected = eliminate_as_in_the_textbook(A, cols);
    for (const front::Kernels* kernels : front::available_kernels()) {
      const int tiles = (rows + front::kTile - 1) / front::kTile;
      std::vector<front::TileColumn> work(static_cast<std::size_t>(front::tile_begin(tiles, rows)));
      const auto element = [&, n = rows](int r, int c) -> double& {
        const int t = r / front::kTile;
        return work[static_cast<std::size_t>(front::tile_begin(t, n) + c)].row[r % front::kTile];
      };
      for (int c = 0; c < rows; ++c) {
        for (int r = c; r < rows; ++r) element(r, c) = A(r, c);
      }
      for (int at = 0; at < cols; at += 96) {
        ASSERT_TRUE(kernels->eliminate(work.data(), rows, at, std::min(96, cols - at)));
      }
      for (int c = 0; c < rows; ++c) {
        for (int r = c; r < rows; ++r) {
          ASSERT_EQ(element(r, c), expected(r, c)) << kernels->name << ' ' << rows << ' ' << cols;
        }
      }
    }
  }
}

TEST(BlockCholesky, EveryVariantGivesTheSameBits) {
  std::set<std::pair<int, int>> pairs;
  for (int r = 1; r < 150; ++r) {
    for (int c = std::max(0, r - 9); c < r; ++c) pairs.insert({r, c});
    if (r % 7 == 0) pairs.insert({r, r / 7});
  }
  const System system = make_system(150, pairs, 6);
  Eigen::VectorXd plain;
  for (const front::Kernels* kernels : front::available_kernels()) {
    BlockCholesky cholesky(system.pattern, *kernels);
    ASSERT_EQ(cholesky.factorise(system.blocks), BlockCholesky::Result::kDone);
    Eigen::VectorXd x = Eigen::VectorXd::Ones(900);
    cholesky.solve(x);
    EXPECT_LT((system.dense * x - Eigen::VectorXd::Ones(900)).norm(), 1e-10) << kernels->name;
    if (plain.size() == 0) plain = x;
    EXPECT_EQ(x, plain) << kernels->name;
  }
}

}  // namespace
}  // namespace kys_slam::test
