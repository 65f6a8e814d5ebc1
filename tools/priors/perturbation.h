#pragma once

#include <kys/label_space.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>

#include "priors/builder/field_input.h"

namespace kys_slam {

/// How many thing segments got another class, of how many.
struct Relabelling {
  std::size_t hit = 0, things = 0;
};

/// Writes a COCO panoptic folder (and its JSON beside it) in which a share of the thing segments
/// has another class that occurs in the sequence; whether it is a thing follows from the new class.
/// A segment is hit when its own random number is below the share, and its new class does not
/// depend on the share: what is hit at 10 % is hit alike at 30 % and 60 %.
/// \param folder,output without a slash at the end.  \throws InputError.
Relabelling relabel_segments(const std::string& folder, const std::string& output, double share,
                             std::uint64_t seed, const kys::LabelSpace& labels);

/// Writes a folder of flow (KITTI PNG) in which each component has an error of `relative` times the
/// flow's length times unit noise: independent per pixel (`correlation` 0), or alike over
/// `correlation` px, a failure that no smoothing removes. At the same seed errors are proportional
/// to `relative`. Pixels without flow stay so. Returns the mean length of the errors, px.
/// \throws InputError.
double disturb_flow(const std::string& folder, const std::string& output, double relative,
                    double correlation, std::uint64_t seed, FieldEncoding encoding);

}  // namespace kys_slam
