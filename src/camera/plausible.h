// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include <string>

namespace kys_slam {

/// Distance between the cameras of a pair, m: the range that every way in accepts.
inline constexpr double kLeastBaseline = 0.005;
inline constexpr double kMostBaseline = 5;

/// \param remedy what to do about a baseline in another unit, in the words of this way in
/// \throws InputError "NAME: the baseline is ...": outside the range above. Says the unit that
/// would fit.
void require_baseline(double metres, const std::string& name, const std::string& remedy);

/// \throws InputError "NAME: what is not plausible": a focal length (px) far from the image size, a
/// principal point far outside the image, a baseline outside the range above.
void require_plausible(const StereoCamera& camera, const std::string& name,
                       const std::string& remedy = "lengths have to be in m");

/// By which factor the sides of images of `width` x `height` px would have to be multiplied to have
/// the principal point in the middle. 1 when it is near the middle already, or when the two sides
/// do not agree (a crop, a lens that is shifted).
double size_factor(double cx, double cy, int width, int height);

/// One sentence about a calibration that seems to be of images of another size; "" when there is no
/// such sign.
std::string other_image_size(double cx, double cy, int width, int height);

/// Whether four intrinsics are fx, cx, fy, cy by their values, not fx, fy, cx, cy.
bool is_other_order(double fx, double fy, double cx, double cy, int width);

/// One sentence about pixels that are far from square; "" when they are not.
std::string unequal_focal_lengths(double fx, double fy);

}  // namespace kys_slam
