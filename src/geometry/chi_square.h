// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace kys_slam {

/// Quantiles of the chi-square distribution (95 % and 99 %), for Gaussian noise of the assumed
/// standard deviation. A monocular observation has 2 degrees of freedom (u, v), a stereo
/// observation 3 (u, v, disparity).
inline constexpr double kChi2Mono95 = 5.991;
inline constexpr double kChi2Stereo95 = 7.815;
inline constexpr double kChi2Mono99 = 9.210;
inline constexpr double kChi2Stereo99 = 11.345;

}  // namespace kys_slam
