// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/image.h>

#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Splits thing segments that cover several objects, one behind the other, where their depths show
/// it: a network without instances gives one segment to a car and those parked behind it. A surface
/// is a set of connected pixels of a segment along which the disparity is continuous. A segment is
/// split if a connected piece of it has large and compact surfaces whose median disparities are far
/// apart. Its other pixels go to the surface that is nearest in the image. Two pieces of a segment
/// that do not touch are not split, whatever their depths: a long object behind a pole has such.
/// The parts follow each other in `segments`, the nearest first, numbered from 1.
/// \param disparity px, NaN: not known
void split_by_depth(const ImageOf<float>& disparity, PanopticMap& panoptic);

}  // namespace kys_slam
