// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image_file.h>

#include <string>
#include <vector>

#include "simulator/images/renderer.h"

namespace kys_slam::simulator {

/// One panoptic segment of one view: a thing, or all of one stuff class.
struct Segment {
  std::uint32_t id =
      0;                ///< in the PNG of this frame: R + 256 G + 65536 B; different in every frame
  int object = -1;      ///< index into Scene::objects; -1 for stuff
  int category = 0;     ///< COCO panoptic
  bool moving = false;  ///< true: moves between this frame and the next
  std::int64_t area = 0;               ///< px
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< bounding box, inclusive
};

struct Panoptic {
  RgbImage ids;  ///< 0: void
  std::vector<Segment> segments;
};

/// Whether each object moves from this frame to the next (of the last one: from the one before).
std::vector<bool> moving_objects(const World& world, int frame);

Panoptic make_panoptic(const World& world, const ViewTruth& truth, int frame, int camera,
                       const std::vector<bool>& moving);

/// KITTI disparity PNG values: round(256 d), 0 where there is none (sky, nearer than 256 px, or not
/// positive because of an error of the rig).
Image16 encode_disparity(const ViewTruth& truth, double bf);
/// KITTI flow PNG values. Valid wherever the flow is known, also where its end is occluded or
/// outside the image, except beyond the range of the format (512 px).
Rgb16Image encode_flow(const ViewTruth& truth);

}  // namespace kys_slam::simulator
