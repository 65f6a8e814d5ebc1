// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>
#include <nanobind/nanobind.h>

#include <memory>

namespace kys_slam {

/// An extractor that calls `extractor._of_image(image)` for both images of a pair: an instance of
/// kys_slam.Features, which must outlive it. Takes the GIL where it needs it.
/// \throws InputError when what it says of itself makes no sense
std::unique_ptr<FeatureExtractor> make_python_extractor(nanobind::handle extractor);

}  // namespace kys_slam
