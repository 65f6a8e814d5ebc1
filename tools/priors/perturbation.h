// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/label_space.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "priors/input/field_input.h"

namespace kys_slam {

/// Number of relabelled thing segments, of all thing segments.
struct Relabelling {
  std::size_t hit = 0, things = 0;
};

/// Writes a COCO panoptic folder (and its JSON) in which a share of the thing segments has another
/// class of the sequence; the new class decides whether it is a thing. A segment is relabelled when
/// its random number is below the share, and its new class does not depend on the share: segments
/// relabelled at 10 % are relabelled alike at 30 % and 60 %.
/// \param folder,output without a slash at the end.  \throws InputError, also when they are one.
Relabelling relabel_segments(const std::string& folder, const std::string& output, double share,
                             std::uint64_t seed, const kys::LabelSpace& labels);

/// Writes a folder of flow (KITTI PNG) in which each component has Gaussian noise of standard
/// deviation `relative` times the length of the flow. The noise is independent per pixel
/// (`correlation` 0) or correlated over `correlation` px, which no smoothing removes. For the same
/// seed errors are proportional to `relative`. Pixels without flow stay invalid. Returns the mean
/// length of the errors, px.
/// \throws InputError, also for a folder without flow, and when both are one folder.
double disturb_flow(const std::string& folder, const std::string& output, double relative,
                    double correlation, std::uint64_t seed, FieldEncoding encoding);

}  // namespace kys_slam
