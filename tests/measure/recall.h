// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

namespace kys_slam {

/// Something a recogniser proposed, with how sure it was.
struct Proposal {
  double score = 0;
  bool correct = false;
};

/// One operating point: everything of at least this score is accepted.
struct RecallPoint {
  double threshold = 0;
  double precision = 1;
  double recall = 0;
};

/// The precision-recall curve over all thresholds, strictest first; equal scores are accepted
/// together. \param expected what could have been proposed correctly, proposed or not
std::vector<RecallPoint> recall_curve(std::vector<Proposal> proposals, std::size_t expected);

/// The point of largest recall whose precision is at least `precision`; recall 0 when there is
/// none.
RecallPoint best_recall(std::span<const RecallPoint> curve, double precision);

}  // namespace kys_slam
