// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace kys_slam {

/// An array that grows at its end; its elements never move. In blocks of 64: with one or a few
/// elements per block, as in a std::deque of large ones, every access waits for two places in
/// memory.
template <typename T>
class StableArray {
 public:
  StableArray() = default;
  StableArray(const StableArray& other) {
    for (std::size_t i = 0; i < other.size(); ++i) push_back(other[i]);
  }
  StableArray(StableArray&& other) noexcept
      : blocks_(std::move(other.blocks_)), size_(std::exchange(other.size_, 0)) {}
  StableArray& operator=(StableArray other) noexcept {
    blocks_.swap(other.blocks_);
    std::swap(size_, other.size_);
    return *this;
  }
  ~StableArray() = default;

  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] T& operator[](std::size_t i) { return blocks_[i / kBlock][i % kBlock]; }
  [[nodiscard]] const T& operator[](std::size_t i) const { return blocks_[i / kBlock][i % kBlock]; }

  T& push_back(T element) {
    if (size_ == kBlock * blocks_.size()) blocks_.push_back(std::make_unique<T[]>(kBlock));
    T& place = (*this)[size_++];
    place = std::move(element);
    return place;
  }

 private:
  static constexpr std::size_t kBlock = 64;

  std::vector<std::unique_ptr<T[]>> blocks_;
  std::size_t size_ = 0;
};

}  // namespace kys_slam
