// SPDX-License-Identifier: BSD-3-Clause
#include "measure/recall.h"

#include <algorithm>
#include <limits>

namespace kys_slam {

std::vector<RecallPoint> recall_curve(std::vector<Proposal> proposals, std::size_t expected) {
  std::sort(proposals.begin(), proposals.end(),
            [](const Proposal& a, const Proposal& b) { return a.score > b.score; });
  std::vector<RecallPoint> curve;
  std::size_t correct = 0;
  for (std::size_t i = 0; i < proposals.size(); ++i) {
    correct += proposals[i].correct ? 1 : 0;
    if (i + 1 < proposals.size() && proposals[i + 1].score == proposals[i].score) continue;
    curve.push_back(
        {proposals[i].score, static_cast<double>(correct) / static_cast<double>(i + 1),
         expected == 0 ? 0 : static_cast<double>(correct) / static_cast<double>(expected)});
  }
  return curve;
}

RecallPoint best_recall(std::span<const RecallPoint> curve, double precision) {
  RecallPoint best{std::numeric_limits<double>::infinity(), 1, 0};
  for (const RecallPoint& point : curve) {
    if (point.precision >= precision && point.recall > best.recall) best = point;
  }
  return best;
}

}  // namespace kys_slam
