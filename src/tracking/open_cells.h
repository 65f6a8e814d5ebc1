// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/statistics.h>

#include <cstdint>
#include <span>
#include <vector>

#include "geometry/image_cells.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

/// Cells of the image (ImageCells, row-major), by what the pose of a frame explains in them.
struct CellCounts {
  std::vector<int> inliers;   ///< of the pose
  std::vector<int> features;  ///< on nothing that is believed to move
  std::vector<int> points;    ///< of these, with a disparity

  [[nodiscard]] bool is_explained(std::size_t cell) const { return inliers[cell] >= kFewest; }
  /// Has stereo points and no inliers.
  [[nodiscard]] bool is_open(std::size_t cell) const {
    return inliers[cell] == 0 && points[cell] >= kFewest;
  }
  /// Has features, with or without a disparity, and no inliers.
  [[nodiscard]] bool is_unexplained(std::size_t cell) const {
    return inliers[cell] == 0 && features[cell] >= kFewest;
  }
  [[nodiscard]] int explained() const;

 private:
  static constexpr int kFewest = 2;  // features that say something
};

/// \param frame with its pose and the inliers of it
/// \param ignored per cell, 1: takes no part; empty: all take part
CellCounts count_cells(const TrackingContext& context, const TrackedFrame& frame,
                       const ImageCells& cells, const std::vector<std::uint8_t>& ignored);

/// At most `limit` of the numbers, evenly.
std::vector<std::size_t> choose_evenly(std::vector<std::size_t> numbers, std::size_t limit);

/// Searches features of the last frame in the whole image by descriptor alone, with loose bounds:
/// what is wrong does not agree with the rest.
/// \return feature of the frame per number, -1: none
std::vector<std::int32_t> find_again(const TrackingContext& context, const TrackedFrame& frame,
                                     std::span<const std::size_t> numbers,
                                     kys::Statistics& statistics);

/// Where something lies relative to what the pose explains in the same rows of the image.
struct DepthOrder {
  int behind = 0;    ///< cells in which it is farther than the pose's inliers beside
  int in_front = 0;  ///< cells in which it is nearer
};

/// Compares the disparities of some stereo features with those of the pose's inliers beside them.
/// \param there features of the frame with a disparity
/// \param where the cells to compare
DepthOrder compare_depths(const TrackedFrame& frame, const ImageCells& cells,
                          std::span<const std::size_t> there, std::span<const std::size_t> where);

}  // namespace kys_slam
