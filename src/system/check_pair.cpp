// SPDX-License-Identifier: BSD-3-Clause
#include <kys/distance_model.h>
#include <kys_slam/check_pair.h>
#include <kys_slam/util/median.h>

#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

#include "features/orb_extractor.h"

namespace kys_slam {

namespace {

constexpr float kLargestDistance = 40;     // bits
constexpr float kLargestRatio = 0.7F;      // of best to second best
constexpr double kBackward = -2;           // px of disparity: more than noise
constexpr double kLargestRowOffset = 1.5;  // px

struct Offsets {
  std::vector<double> rows;         // right row - left row, px
  std::vector<double> disparities;  // px
};

/// Unambiguous matches of two images, wherever they are in the image.
Offsets match_everywhere(const FeatureSet& left, const FeatureSet& right) {
  const kys::DistanceModel model;
  std::vector<std::uint32_t> candidates(right.size());
  std::iota(candidates.begin(), candidates.end(), 0U);
  kys::Statistics statistics;
  Offsets offsets;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const kys::BestTwo found = model.best_two(left.descriptors[i], {}, right.descriptors, {},
                                              candidates, kys::Context::kStereo, statistics);
    if (found.index == kys::BestTwo::kNone || found.best.value > kLargestDistance ||
        found.best.value > kLargestRatio * found.second.value) {
      continue;
    }
    const Keypoint& l = left.keypoints[i];
    const Keypoint& r = right.keypoints[found.index];
    offsets.rows.push_back(r.y - l.y);
    offsets.disparities.push_back(l.x - r.x);
  }
  return offsets;
}

std::string judge(const PairCheck& check) {
  char text[240] = "";
  // Rows first: a camera that is turned shifts far points to the other side as well.
  if (std::abs(check.row_offset) > kLargestRowOffset || check.row_spread > kLargestRowOffset) {
    std::snprintf(text, sizeof text,
                  "the pair is not rectified: rows of %zu matches differ by %.1f px (median), "
                  "spread %.1f px; are calibration and images of one rig and of one moment?",
                  check.matches, check.row_offset, check.row_spread);
  } else if (check.backward_share > 0.5) {
    std::snprintf(text, sizeof text,
                  "left and right are swapped: %.0f %% of %zu matches lie further right in the "
                  "right image (so they do where both are upside down or mirrored)",
                  100 * check.backward_share, check.matches);
  }
  return text;
}

}  // namespace

PairCheck check_stereo_pair(const GrayImage& left, const GrayImage& right) {
  OrbOptions options;
  options.features = 800;
  OrbExtractor extractor(options);
  FeatureSet l, r;
  extractor.extract(left, l);
  extractor.extract(right, r);
  Offsets offsets = match_everywhere(l, r);
  PairCheck check;
  check.matches = offsets.rows.size();
  if (check.matches < PairCheck::kMinMatches) return check;
  for (const double d : offsets.disparities) {
    check.backward_share += (d < kBackward ? 1.0 : 0.0) / static_cast<double>(check.matches);
  }
  check.median_disparity = median(offsets.disparities);
  check.row_offset = median(offsets.rows);
  for (double& row : offsets.rows) row = std::abs(row - check.row_offset);
  check.row_spread = median(offsets.rows);
  check.problem = judge(check);
  return check;
}

}  // namespace kys_slam
