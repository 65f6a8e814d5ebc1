// SPDX-License-Identifier: BSD-3-Clause
#include "camera/plausible.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace kys_slam {

void require_plausible(const StereoCamera& camera, const std::string& name) {
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
    throw InputError(name + ": the principal point is far outside the image");
  }
  if (!(camera.baseline < 1000)) throw InputError(name + ": a baseline of more than 1 km");
}

}  // namespace kys_slam
