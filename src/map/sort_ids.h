// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace kys_slam {

/// Sorts ids and removes duplicates. Ids of covisible keyframes are close together, so one bit per
/// id between the least and the greatest is faster than comparisons.
template <typename IdType>
void sort_unique(std::vector<IdType>& ids) {
  if (ids.empty()) return;
  const auto [least, greatest] = std::minmax_element(ids.begin(), ids.end());
  const std::uint32_t first = least->value;
  const std::size_t words = (std::size_t{greatest->value} - first) / 64 + 1;
  if (words > ids.size()) {
    std::sort(ids.begin(), ids.end());
    ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
    return;
  }
  std::vector<std::uint64_t> present(words, 0);
  for (const IdType id : ids) {
    present[(id.value - first) / 64] |= std::uint64_t{1} << ((id.value - first) % 64);
  }
  std::size_t count = 0;
  for (std::size_t w = 0; w < words; ++w) {
    for (std::uint64_t bits = present[w]; bits != 0; bits &= bits - 1) {
      const auto at =
          static_cast<std::uint32_t>(64 * w + static_cast<std::size_t>(std::countr_zero(bits)));
      ids[count++] = IdType{first + at};
    }
  }
  ids.resize(count);
}

/// Of a sorted vector without twins.
template <typename IdType>
void insert_sorted(std::vector<IdType>& ids, IdType id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at == ids.end() || *at != id) ids.insert(at, id);
}

template <typename IdType>
void erase_sorted(std::vector<IdType>& ids, IdType id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at != ids.end() && *at == id) ids.erase(at);
}

}  // namespace kys_slam
