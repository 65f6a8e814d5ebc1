// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>
#include <kys_slam/segment_runs.h>

#include <cstdint>
#include <vector>

namespace kys_slam {

/// A segment of the input segmentation.
struct InputSegment {
  std::uint32_t input_id = 0;  ///< its number in the input file; 0 for merged stuff
  std::uint16_t label = 0;     ///< dense index in the label space
  bool thing = false;
  std::uint16_t part = 0;  ///< from 1: a part of that segment, see split_by_depth(); 0: all of it
};

/// A panoptic map in one convention for all input encodings: one segment per stuff class, one per
/// thing segment, none empty, in order of (label, input id).
struct PanopticMap {
  ImageOf<std::uint16_t> map;  ///< 0 void, k = segments[k-1]
  std::vector<InputSegment> segments;
  SegmentRuns runs;  ///< of the map; if empty, fusion computes them
};

/// Size and position of a segment.
struct SegmentShape {
  std::uint32_t area = 0;  ///< px
  double u = 0;            ///< px, centroid
  double v = 0;            ///< px
};

/// Area and centroid of every segment, index k-1.
std::vector<SegmentShape> segment_shapes(const SegmentRuns& runs, std::size_t segment_count);

/// 1 for stuff, by segment number; [0] (void) is 0.
std::vector<std::uint8_t> stuff_mask(const PanopticMap& map);

}  // namespace kys_slam
