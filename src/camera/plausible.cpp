// SPDX-License-Identifier: BSD-3-Clause
#include "camera/plausible.h"

#include <fmt/format.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace kys_slam {

void require_baseline(double metres, const std::string& name, const std::string& remedy) {
  const auto fits = [](double b) { return b >= kLeastBaseline && b <= kMostBaseline; };
  if (fits(metres)) return;
  std::string text = fmt::format("{}: the baseline is {:.6g} m; pairs have {} to {} m", name,
                                 metres, kLeastBaseline, kMostBaseline);
  constexpr std::array<std::pair<const char*, double>, 3> kUnits{
      {{"cm", 0.01}, {"mm", 0.001}, {"um", 1e-6}}};
  const char* joint = ". Is it in another unit? ";
  for (const auto& [unit, factor] : kUnits) {
    if (!fits(metres * factor)) continue;
    text += fmt::format("{}{:.6g} {} are {:.6g} m", joint, metres, unit, metres * factor);
    joint = ", ";
  }
  throw InputError(text + "; " + remedy);
}

void require_plausible(const StereoCamera& camera, const std::string& name,
                       const std::string& remedy) {
  const double side = std::max(camera.width, camera.height);
  char text[128];
  for (const double focal : {camera.fx, camera.fy}) {
    // From a view of 178 degrees to one of 3 minutes of arc.
    if (focal > 0.01 * side && focal < 1000 * side) continue;
    std::snprintf(text, sizeof text, "focal length of %g px for images of %dx%d px", focal,
                  camera.width, camera.height);
    throw InputError(name + ": " + text);
  }
  if (!(std::abs(camera.cx) < 10 * side && std::abs(camera.cy) < 10 * side)) {
    throw InputError(
        name +
        ": the principal point is far outside the image (coefficients of a lens are k1, "
        "k2, p1, p2, k3; intrinsics fx, fy, cx, cy)");
  }
  require_baseline(camera.baseline, name, remedy);
}

double size_factor(double cx, double cy, int width, int height) {
  // Principal points are within a tenth of the middle, of rectified wide lenses within a sixth.
  constexpr double kLeast = 1.2;
  constexpr double kMostDifference = 1.15;  // of the two sides
  const double x = (2 * cx + 1) / width, y = (2 * cy + 1) / height;
  if (!(x > 0 && y > 0) || std::max(x, y) > kMostDifference * std::min(x, y)) return 1;
  if (std::min(x, y) < kLeast && std::max(x, y) > 1 / kLeast) return 1;
  return std::sqrt(x * y);
}

std::string other_image_size(double cx, double cy, int width, int height) {
  const double factor = size_factor(cx, cy, width, height);
  if (factor == 1) return "";
  return fmt::format(
      "the calibration seems to be of images of about {:.0f}x{:.0f} px, these are {}x{}: the "
      "principal point is at ({:.1f}, {:.1f}). If the images were resized, multiply fx, fy, cx and "
      "cy "
      "by {:.3g}",
      factor * width, factor * height, width, height, cx, cy, 1 / factor);
}

bool is_other_order(double fx, double fy, double cx, double cy, int width) {
  constexpr double kDiffers = 1.1, kAgrees = 1.05;  // of two focal lengths
  constexpr double kMiddle = 0.2;                   // of the width, around the middle
  const auto ratio = [](double a, double b) { return std::max(a, b) / std::min(a, b); };
  if (!(fx > 0 && fy > 0 && cx > 0 && cy > 0) || ratio(fx, fy) < kDiffers) return false;
  return ratio(fx, cx) < kAgrees && std::abs(2 * fy + 1 - width) < kMiddle * width;
}

std::string unequal_focal_lengths(double fx, double fy) {
  constexpr double kMost = 1.25;
  if (std::max(fx, fy) <= kMost * std::min(fx, fy)) return "";
  return fmt::format(
      "fx and fy are {:.1f} and {:.1f} px: pixels are nearly square in most cameras; is one of "
      "them "
      "wrong, or were the images stretched?",
      fx, fy);
}

}  // namespace kys_slam
