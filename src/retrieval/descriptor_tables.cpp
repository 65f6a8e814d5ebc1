// SPDX-License-Identifier: BSD-3-Clause
#include "retrieval/descriptor_tables.h"

#include <kys_slam/util/hash.h>

#include <numeric>
#include <stdexcept>
#include <utility>

namespace kys_slam {

namespace {

constexpr std::size_t kKeys = std::size_t{1} << DescriptorTables::kKeyBits;

/// SplitMix64 (Steele et al. 2014): the same numbers with every standard library.
std::uint64_t next_random(std::uint64_t& state) {
  const std::uint64_t number = mix(state);
  state += 0x9e3779b97f4a7c15u;
  return number;
}

}  // namespace

DescriptorTables::DescriptorTables(int tables, std::uint64_t seed)
    : tables_(tables), buckets_(static_cast<std::size_t>(tables) * kKeys) {
  if (tables < 1 || tables > kMaxTables) throw std::invalid_argument("number of tables");
  std::iota(bits_.begin(), bits_.end(), std::uint8_t{0});
  for (std::size_t i = bits_.size() - 1; i > 0; --i) {
    std::swap(bits_[i], bits_[next_random(seed) % (i + 1)]);
  }
}

std::size_t DescriptorTables::key(const kys::Descriptor& descriptor, int table) const {
  const auto first = static_cast<std::size_t>(table * kKeyBits);
  std::size_t key = 0;
  for (std::size_t i = first; i < first + kKeyBits; ++i) {
    const std::uint8_t bit = bits_[i];
    key = (key << 1) | ((descriptor.words[bit / 64] >> (bit % 64)) & 1u);
  }
  return static_cast<std::size_t>(table) * kKeys + key;
}

void DescriptorTables::insert(const kys::Descriptor& descriptor, std::uint32_t number) {
  for (int t = 0; t < tables_; ++t) pool_.push(buckets_[key(descriptor, t)], number);
}

void DescriptorTables::erase(const kys::Descriptor& descriptor, std::uint32_t number) {
  for (int t = 0; t < tables_; ++t) {
    if (!pool_.remove(buckets_[key(descriptor, t)], number)) {
      throw std::logic_error("descriptor is not in its hash table");
    }
  }
}

std::size_t DescriptorTables::bytes() const {
  return pool_.bytes() + buckets_.size() * sizeof(ListPool::List);
}

}  // namespace kys_slam
