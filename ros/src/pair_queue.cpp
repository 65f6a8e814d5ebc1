// SPDX-License-Identifier: BSD-3-Clause
#include "pair_queue.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace kys_slam::ros {

PairQueue::PairQueue(double tolerance, std::size_t size, double jump)
    : tolerance_(std::llround(1e9 * tolerance)),
      size_(std::max<std::size_t>(1, size)),
      jump_(std::llround(1e9 * jump)) {}

void PairQueue::clear() {
  for (auto& images : waiting_) images.clear();
  last_ = {};
  pairs_.clear();
}

PairQueue::Arrival PairQueue::add(Side side, ImageMessage message) {
  const auto i = static_cast<std::size_t>(side);
  const std::int64_t stamp = message.stamp.nanoseconds();
  Arrival arrival = Arrival::kTaken;
  if (last_[i] && stamp <= *last_[i]) {
    if (*last_[i] - stamp < jump_ || stamp == *last_[i]) {
      ++counts_.out_of_order;
      return Arrival::kOutOfOrder;
    }
    clear();
    arrival = Arrival::kTimeJump;
  }
  last_[i] = stamp;
  waiting_[i].push_back(std::move(message));
  match();
  if (waiting_[i].size() > size_) {
    waiting_[i].pop_front();
    ++counts_.unmatched;
  }
  return arrival;
}

/// Pairs images from the oldest on. Of two candidates the nearer one counts.
void PairQueue::match() {
  auto& [left, right] = waiting_;
  while (!left.empty() && !right.empty()) {
    const std::int64_t difference =
        left.front().stamp.nanoseconds() - right.front().stamp.nanoseconds();
    auto& older = difference < 0 ? left : right;
    const auto& newer = difference < 0 ? right : left;
    const bool next_is_nearer =
        older.size() > 1 && std::abs(older[1].stamp.nanoseconds() -
                                     newer.front().stamp.nanoseconds()) < std::abs(difference);
    if (std::abs(difference) > tolerance_ || next_is_nearer) {
      older.pop_front();
      ++counts_.unmatched;
      continue;
    }
    pairs_.push_back({std::move(left.front()), std::move(right.front())});
    left.pop_front();
    right.pop_front();
    ++counts_.paired;
    if (pairs_.size() > size_) {
      pairs_.pop_front();
      ++counts_.dropped;
    }
  }
}

std::optional<PairQueue::Pair> PairQueue::take() {
  if (pairs_.empty()) return std::nullopt;
  Pair pair = std::move(pairs_.front());
  pairs_.pop_front();
  return pair;
}

}  // namespace kys_slam::ros
