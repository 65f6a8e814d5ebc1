// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "util/stable_array.h"

namespace kys_slam {

/// Objects stored by value, found by id in constant time, visited in id order. Slots of erased
/// objects are reused: memory depends on the number of present objects, plus four bytes per id ever
/// used, which also hold the successors of replaced objects. References stay valid until their
/// object is erased. When memory runs out, a call throws std::bad_alloc and changes no object.
template <typename IdType, typename T>
class IdTable {
 public:
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  /// One past the largest id that was ever in the table.
  [[nodiscard]] std::uint32_t id_end() const { return static_cast<std::uint32_t>(slot_.size()); }

  [[nodiscard]] bool contains(IdType id) const {
    return id.value < slot_.size() && slot_[id.value] >= 0;
  }
  [[nodiscard]] const T* find(IdType id) const {
    return contains(id) ? &objects_[static_cast<std::size_t>(slot_[id.value])] : nullptr;
  }
  [[nodiscard]] T* find(IdType id) {
    return contains(id) ? &objects_[static_cast<std::size_t>(slot_[id.value])] : nullptr;
  }
  /// \throws std::out_of_range when there is no such object.
  [[nodiscard]] const T& at(IdType id) const {
    const T* object = find(id);
    if (object == nullptr) throw std::out_of_range("no object with this id in the map");
    return *object;
  }
  [[nodiscard]] T& at(IdType id) { return const_cast<T&>(std::as_const(*this).at(id)); }

  /// Inserts, or replaces the object that has this id.
  T& put(IdType id, T object) {
    if (T* old = find(id)) {
      *old = std::move(object);
      return *old;
    }
    make_slot(id);
    std::int32_t slot = static_cast<std::int32_t>(objects_.size());
    if (free_.empty()) {
      objects_.push_back(std::move(object));
    } else {
      slot = free_.back();
      free_.pop_back();
      objects_[static_cast<std::size_t>(slot)] = std::move(object);
    }
    slot_[id.value] = slot;
    ++size_;
    return objects_[static_cast<std::size_t>(slot)];
  }

  /// Returns whether there was such an object.
  bool erase(IdType id) {
    if (!contains(id)) return false;
    const std::int32_t slot = slot_[id.value];
    free_.push_back(slot);
    objects_[static_cast<std::size_t>(slot)] = T{};
    slot_[id.value] = kNone;
    --size_;
    return true;
  }

  /// Erases the object if it is present, and records which one replaced it.
  /// \throws std::length_error for a successor of 2^31 - 2 and more.
  void replace(IdType id, IdType successor) {
    if (successor.value > kLastSuccessor) throw std::length_error("id too large for a successor");
    erase(id);
    make_slot(id);
    slot_[id.value] = kNone - 1 - static_cast<std::int32_t>(successor.value);
  }
  /// `id` itself when present, its present successor when it was replaced, invalid when erased.
  [[nodiscard]] IdType resolve(IdType id) const {
    while (!contains(id)) {
      if (id.value >= slot_.size() || slot_[id.value] == kNone) return {};
      id = IdType{static_cast<std::uint32_t>(kNone - 1 - slot_[id.value])};
    }
    return id;
  }

  void clear() { *this = IdTable{}; }

  /// Marks all ids below `end` as used.
  void skip_ids(std::uint32_t end) {
    if (end > slot_.size()) slot_.resize(end, kNone);
  }

  /// Calls f(id, object) in id order.
  template <typename F>
  void for_each(F&& f) const {
    for (std::uint32_t i = 0; i < slot_.size(); ++i) {
      if (slot_[i] >= 0) f(IdType{i}, objects_[static_cast<std::size_t>(slot_[i])]);
    }
  }
  /// Calls f(id, object) for the present ones of `ids`, in their order. Fetches ahead what it will
  /// need: objects are where they were put, all over the memory.
  template <typename F>
  void visit(std::span<const IdType> ids, F&& f) const {
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (k + 2 * kAhead < ids.size()) prefetch_slot(ids[k + 2 * kAhead]);
      if (k + kAhead < ids.size()) {
        if (const T* later = find(ids[k + kAhead])) __builtin_prefetch(later);
      }
      if (const T* object = find(ids[k])) f(ids[k], *object);
    }
  }
  /// Ids of the present objects, increasing.
  [[nodiscard]] std::vector<IdType> ids() const {
    std::vector<IdType> all;
    all.reserve(size_);
    for_each([&](IdType id, const T&) { all.push_back(id); });
    return all;
  }

 private:
  void prefetch_slot(IdType id) const {
    if (id.value < slot_.size()) __builtin_prefetch(&slot_[id.value]);
  }
  void make_slot(IdType id) {
    if (id.value >= slot_.size()) slot_.resize(static_cast<std::size_t>(id.value) + 1, kNone);
  }

  static constexpr std::int32_t kNone = -1;
  static constexpr std::size_t kAhead = 8;
  static constexpr std::uint32_t kLastSuccessor = 0x7FFFFFFDu;

  std::vector<std::int32_t> slot_;  // by id; kNone, or below it: kNone - 1 - id of the successor
  StableArray<T> objects_;
  std::vector<std::int32_t> free_;
  std::size_t size_ = 0;
};

}  // namespace kys_slam
