#pragma once

namespace kys_slam {

/// Bounds of the chi-square distribution: the share of errors below is the confidence when noise is
/// Gaussian of the deviation assumed. A monocular observation has 2 degrees of freedom (u, v), a
/// stereo one 3 (u, v, disparity).
inline constexpr double kChi2Mono95 = 5.991;
inline constexpr double kChi2Stereo95 = 7.815;
inline constexpr double kChi2Mono99 = 9.210;
inline constexpr double kChi2Stereo99 = 11.345;

}  // namespace kys_slam
