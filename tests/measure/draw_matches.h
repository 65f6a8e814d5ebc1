// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/features.h>
#include <kys_slam/image.h>
#include <kys_slam/image_file.h>

#include <span>
#include <utility>

namespace kys_slam {

/// Two grey images side by side, matches as coloured lines from one to the other.
RgbImage draw_matches(const GrayImage& left, const GrayImage& right,
                      std::span<const std::pair<Keypoint, Keypoint>> matches);

}  // namespace kys_slam
