// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/descriptor.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "retrieval/list_pool.h"

namespace kys_slam {

/// Hash tables over binary descriptors (locality-sensitive hashing: Indyk and Motwani 1998; the
/// disjoint substrings of multi-index hashing: Norouzi et al. 2012). Each table uses 16 bits of a
/// descriptor as its key; no bit is used twice. A table finds a descriptor that differs in r bits
/// with probability about (1 - r/256)^16. A preselection: the caller compares the candidates found.
/// The result depends on the set of inserted descriptors, not on their order.
class DescriptorTables {
 public:
  static constexpr int kKeyBits = 16;
  static constexpr int kMaxTables = 256 / kKeyBits;

  /// \param tables 1 to kMaxTables
  /// \param seed chooses the bits of each table
  DescriptorTables(int tables, std::uint64_t seed);

  /// Inserts a number under a descriptor.
  void insert(const kys::Descriptor& descriptor, std::uint32_t number);
  /// Removes a number; the descriptor must be the one of its insertion.
  void erase(const kys::Descriptor& descriptor, std::uint32_t number);

  /// Key of a descriptor in a table.
  [[nodiscard]] std::size_t key(const kys::Descriptor& descriptor, int table) const;
  /// The numbers under a key, in any order.
  [[nodiscard]] std::span<const std::uint32_t> bucket(std::size_t key) const {
    return pool_.view(buckets_[key]);
  }
  /// Prefetches the handle of a bucket, or its numbers: a look-up has two dependent memory
  /// accesses.
  void prefetch_handle(std::size_t key) const { __builtin_prefetch(&buckets_[key]); }
  void prefetch_numbers(std::size_t key) const { pool_.prefetch(buckets_[key]); }
  [[nodiscard]] int tables() const { return tables_; }
  [[nodiscard]] std::size_t bytes() const;

 private:
  int tables_;
  std::array<std::uint8_t, 256> bits_{};  // table t uses bits_[16 t] to bits_[16 t + 15]
  std::vector<ListPool::List> buckets_;   // by table, then key
  ListPool pool_;
};

}  // namespace kys_slam
