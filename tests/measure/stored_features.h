// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>

#include <filesystem>
#include <memory>

namespace kys_slam {

/// Features that another extractor found before, as store_features.py writes them: looked up by the
/// pixels of the image. \throws InputError naming the file
std::unique_ptr<FeatureExtractor> open_stored_features(const std::filesystem::path& file);

}  // namespace kys_slam
