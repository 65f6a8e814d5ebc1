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
/// disjoint substrings of multi-index hashing: Norouzi et al. 2012). Each table files a descriptor
/// under 16 of its bits, no bit is used twice; a descriptor that differs from another one in r bits
/// is found by a table with probability about (1 - r/256)^16. Preselects only: who is found has to
/// be compared by the caller. What is found depends on the set of what was inserted, not on its
/// order.
class DescriptorTables {
 public:
  static constexpr int kKeyBits = 16;
  static constexpr int kMaxTables = 256 / kKeyBits;

  /// \param tables 1 to kMaxTables
  /// \param seed chooses the bits of each table
  DescriptorTables(int tables, std::uint64_t seed);

  /// Files a number under a descriptor.
  void insert(const kys::Descriptor& descriptor, std::uint32_t number);
  /// Takes it out again; the descriptor has to be the one it was filed under.
  void erase(const kys::Descriptor& descriptor, std::uint32_t number);

  /// Where a table files a descriptor.
  [[nodiscard]] std::size_t key(const kys::Descriptor& descriptor, int table) const;
  /// The numbers filed under a key, in any order.
  [[nodiscard]] std::span<const std::uint32_t> bucket(std::size_t key) const {
    return pool_.view(buckets_[key]);
  }
  /// Has the bucket's handle, or its numbers, brought near: a look-up waits for memory twice.
  void prefetch_handle(std::size_t key) const { __builtin_prefetch(&buckets_[key]); }
  void prefetch_numbers(std::size_t key) const { pool_.prefetch(buckets_[key]); }
  [[nodiscard]] int tables() const { return tables_; }
  [[nodiscard]] std::size_t bytes() const;

 private:
  int tables_;
  std::array<std::uint8_t, 256> bits_{};  // table t looks at bits_[16 t] to bits_[16 t + 15]
  std::vector<ListPool::List> buckets_;   // by table, then key
  ListPool pool_;
};

}  // namespace kys_slam
