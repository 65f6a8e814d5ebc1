// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <vector>

namespace kys_slam {

/// Many short lists of 32-bit numbers. A list takes its 8-byte handle and a block of 1, 2, 3, 4, 6,
/// 8, 12, 16, ... cells. Blocks of emptied lists are reused. Only the list that grows is moved, so
/// the time of a call is at most linear in the length of its list.
class ListPool {
 public:
  /// Handle of a list; a default-constructed one is empty. Valid for its pool only.
  struct List {
    std::uint32_t begin = 0;
    std::uint32_t size : 26 = 0;
    std::uint32_t order : 6 = kNoBlock;  ///< of the block, which has capacity(order) cells
  };

  [[nodiscard]] std::span<const std::uint32_t> view(const List& list) const {
    if (list.size == 0) return {};
    return {cells(list.begin), list.size};
  }

  /// Prefetches the numbers of a list.
  void prefetch(const List& list) const {
    if (list.size > 0) __builtin_prefetch(cells(list.begin));
  }

  /// \throws std::length_error for a list of more than 2^20 numbers.
  void push(List& list, std::uint32_t value) {
    if (list.order == kNoBlock) {
      list.begin = allocate(0);
      list.order = 0;
    } else if (list.size == capacity(list.order)) {
      grow(list);
    }
    cells(list.begin)[list.size] = value;
    list.size = list.size + 1;
  }

  /// Removes one occurrence and moves the last number to its position. Returns whether there was
  /// one.
  bool remove(List& list, std::uint32_t value) {
    std::uint32_t* const first = list.size > 0 ? cells(list.begin) : nullptr;
    for (std::uint32_t i = 0; i < list.size; ++i) {
      if (first[i] != value) continue;
      first[i] = first[list.size - 1];
      list.size = list.size - 1;
      if (list.size == 0) clear(list);
      return true;
    }
    return false;
  }

  void clear(List& list) {
    if (list.order != kNoBlock) free_[list.order].push_back(list.begin);
    list = {};
  }

  /// Bytes held for blocks, used or free.
  [[nodiscard]] std::size_t bytes() const {
    return ((chunks_.empty() ? 0 : chunks_.size() - 1) * kChunk + used_in_last_) *
           sizeof(std::uint32_t);
  }

 private:
  static constexpr unsigned kNoBlock = 63;
  static constexpr unsigned kChunkBits = 20;
  static constexpr std::uint32_t kChunk = 1u << kChunkBits;      // cells
  static constexpr unsigned kLargestOrder = 2 * kChunkBits - 1;  // one whole chunk

  /// 1, 2, 3, 4, 6, 8, 12, 16, ...
  static constexpr std::uint32_t capacity(unsigned order) {
    if (order == 0) return 1;
    return order % 2 == 1 ? 2u << (order / 2) : 3u << (order / 2 - 1);
  }

  [[nodiscard]] std::uint32_t* cells(std::uint32_t at) const {
    return chunks_[at >> kChunkBits].get() + (at & (kChunk - 1));
  }

  std::uint32_t allocate(unsigned order) {
    if (order > kLargestOrder) throw std::length_error("list of more than 2^20 numbers");
    if (!free_[order].empty()) {
      const std::uint32_t at = free_[order].back();
      free_[order].pop_back();
      return at;
    }
    const std::uint32_t count = capacity(order);
    if (chunks_.empty() || kChunk - used_in_last_ < count) {
      // Not initialised: pages that no list uses are never touched. The rest of the chunk before
      // becomes blocks of its own.
      if (!chunks_.empty()) give_away_rest();
      chunks_.emplace_back(new std::uint32_t[kChunk]);
      used_in_last_ = 0;
    }
    const auto at =
        static_cast<std::uint32_t>(((chunks_.size() - 1) << kChunkBits) + used_in_last_);
    used_in_last_ += count;
    return at;
  }

  void give_away_rest() {
    unsigned order = kLargestOrder;
    while (used_in_last_ < kChunk) {
      while (capacity(order) > kChunk - used_in_last_) --order;
      free_[order].push_back(
          static_cast<std::uint32_t>(((chunks_.size() - 1) << kChunkBits) + used_in_last_));
      used_in_last_ += capacity(order);
    }
  }

  void grow(List& list) {
    const std::uint32_t at = allocate(list.order + 1u);
    const std::uint32_t* const from = cells(list.begin);
    std::uint32_t* const to = cells(at);
    for (std::uint32_t i = 0; i < list.size; ++i) to[i] = from[i];
    free_[list.order].push_back(list.begin);
    list.begin = at;
    list.order = (list.order + 1u) & 63u;
  }

  std::vector<std::unique_ptr<std::uint32_t[]>> chunks_;
  std::uint32_t used_in_last_ = 0;
  std::array<std::vector<std::uint32_t>, kLargestOrder + 1> free_;  // blocks, by order
};

}  // namespace kys_slam
