// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <map>
#include <span>
#include <vector>

#include "priors/fusion/object_segments.h"

namespace kys_slam {

/// Pixels of every thing segment under every expected mask, by segment number and thing.
using Claims = std::vector<std::map<std::size_t, int>>;

Claims find_claims(std::span<const ExpectedThing> expected, const PanopticMap& panoptic);

/// The steps of make_objects(). The map has runs, before and after.
void split_merged(std::span<const ExpectedThing> expected, PanopticMap& panoptic);
void join_parts(const ImageOf<float>& disparity, const ObjectClasses& classes,
                std::span<const ExpectedThing> expected, PanopticMap& panoptic);

}  // namespace kys_slam
