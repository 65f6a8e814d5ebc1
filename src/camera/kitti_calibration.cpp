// SPDX-License-Identifier: BSD-3-Clause
#include "camera/kitti_calibration.h"

#include <kys_slam/error.h>

#include "camera/plausible.h"

namespace kys_slam {

StereoCamera stereo_camera_from_projections(const ProjectionMatrix& P_left,
                                            const ProjectionMatrix& P_right, int width, int height,
                                            const std::string& name) {
  const auto fail = [&](const std::string& what) { throw InputError(name + ": " + what); };
  if (!P_left.allFinite() || !P_right.allFinite()) fail("calibration with non-finite numbers");
  const double fx = P_left(0, 0);
  const double fy = P_left(1, 1);
  if (!(fx > 0 && fy > 0)) fail("focal length is not positive");
  const double tolerance = 1e-3 * fx;
  if ((P_left.leftCols<3>() - P_right.leftCols<3>()).cwiseAbs().maxCoeff() > tolerance) {
    fail("the projection matrices of the left and right camera are not a rectified pair");
  }
  if (std::abs(P_left(0, 1)) > tolerance || std::abs(P_left(1, 0)) > tolerance ||
      std::abs(P_left(2, 2) - 1) > 1e-6) {
    fail("projection matrix is not of the form K [I | t]");
  }
  StereoCamera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = fx;
  camera.fy = fy;
  camera.cx = P_left(0, 2);
  camera.cy = P_left(1, 2);
  camera.baseline = (P_left(0, 3) - P_right(0, 3)) / fx;
  if (!(camera.baseline > 0)) fail("the right camera is not to the right of the left one");
  if (!camera.is_valid()) fail("invalid calibration");
  require_plausible(camera, name,
                    "the fourth number of the right camera's row is -fx * baseline, px m");
  // KITTI's own rows differ by 1 % of the baseline; beyond this, rows do not match.
  const double rows_apart = std::abs(P_left(1, 3) - P_right(1, 3));
  if (rows_apart > 0.05 * camera.bf()) {
    fail("the right camera is above or below the left one: not a rectified pair");
  }
  return camera;
}

}  // namespace kys_slam
