// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>
#include <kys_slam/segment_image.h>

#include <memory>

#include "messages.h"

namespace kys_slam::ros {

/// The segments of a label image. Encodings 16UC1, mono16 and 32SC1: one value per pixel, class *
/// divisor + instance. mono8 and 8UC1: classes alone; connected parts of things of at least 150 px
/// are instances, smaller ones void. Classes have the numbers of the label space's data set
/// (LabelClass::id); those that are not in it and negative values are void.
/// \throws InputError for other encodings, too few bytes, more than 65535 segments, and for an
/// image none of whose classes is known
std::shared_ptr<SegmentImage> segments_of(const ImageMessage& message, const kys::LabelSpace& space,
                                          int divisor);

}  // namespace kys_slam::ros
