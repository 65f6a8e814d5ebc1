// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/open_cells.h"

#include <algorithm>
#include <deque>

#include "matching/descriptor_matcher.h"

namespace kys_slam {

int CellCounts::explained() const {
  int count = 0;
  for (std::size_t cell = 0; cell < inliers.size(); ++cell) count += is_explained(cell) ? 1 : 0;
  return count;
}

CellCounts count_cells(const TrackingContext& c, const TrackedFrame& frame, const ImageCells& cells,
                       const std::vector<std::uint8_t>& ignored) {
  const std::vector<int> none(cells.size());
  CellCounts counts{none, none, none};
  for (std::size_t i = 0; i < frame.features->size(); ++i) {
    const Keypoint& k = frame.features->keypoint(i);
    const std::size_t cell = cells.index(k.x, k.y);
    if (!ignored.empty() && ignored[cell] != 0) continue;
    if (frame.landmarks[i].valid()) ++counts.inliers[cell];
    if (!c.beliefs.is_static(frame.features->prior(i))) continue;
    ++counts.features[cell];
    if (frame.features->has_stereo(i)) ++counts.points[cell];
  }
  return counts;
}

std::vector<std::size_t> choose_evenly(std::vector<std::size_t> numbers, std::size_t limit) {
  if (numbers.size() <= limit) return numbers;
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < limit; ++k) {
    chosen.push_back(numbers[(2 * k + 1) * numbers.size() / (2 * limit)]);
  }
  return chosen;
}

std::vector<std::int32_t> find_again(const TrackingContext& c, const TrackedFrame& frame,
                                     std::span<const std::size_t> numbers,
                                     kys::Statistics& statistics) {
  const FrameFeatures& before = *c.last->features;
  std::deque<kys::Prior> priors;
  std::vector<DescriptorQuery> queries;
  for (const std::size_t i : numbers) {
    queries.push_back({&before.descriptor(i),
                       &priors.emplace_back(c.beliefs.with_belief(before.prior(i))),
                       before.keypoint(i).angle});
  }
  const DescriptorMatchOptions options{80, 0.85f, true};
  return match_descriptors(queries, *frame.features, options, c.model, statistics);
}

namespace {

constexpr int kBeside = 2;       // cells to the left and right in which depths are compared
constexpr double kNearer = 1.1;  // ratio of disparities that shows which of two surfaces is nearer

/// Median; values are reordered. 0: there are none.
float median_of(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

DepthOrder compare_depths(const TrackedFrame& frame, const ImageCells& cells,
                          std::span<const std::size_t> there, std::span<const std::size_t> where) {
  const FrameFeatures& features = *frame.features;
  const auto add = [&](std::size_t i, std::vector<std::vector<float>>& disparities) {
    const Keypoint& k = features.keypoint(i);
    disparities[cells.index(k.x, k.y)].push_back(k.x - features.u_right(i));
  };
  std::vector<std::vector<float>> of_pose(cells.size()), of_there(cells.size());
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (frame.landmarks[i].valid() && features.has_stereo(i)) add(i, of_pose);
  }
  for (const std::size_t i : there) add(i, of_there);
  DepthOrder order;
  for (const std::size_t cell : where) {
    const int column = static_cast<int>(cell) % kAreaColumns;
    std::vector<float> beside;
    for (int c = std::max(0, column - kBeside); c <= std::min(kAreaColumns - 1, column + kBeside);
         ++c) {
      const std::vector<float>& values = of_pose[cell - static_cast<std::size_t>(column - c)];
      beside.insert(beside.end(), values.begin(), values.end());
    }
    const double pose = median_of(beside), here = median_of(of_there[cell]);
    if (pose <= 0 || here <= 0) continue;
    if (pose > kNearer * here) ++order.behind;
    if (here > kNearer * pose) ++order.in_front;
  }
  return order;
}

}  // namespace kys_slam
