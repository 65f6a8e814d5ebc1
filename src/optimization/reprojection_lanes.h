// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/stereo_camera.h>

#include "geometry/reprojection.h"
#include "util/lanes.h"

namespace kys_slam {

/// reprojection_error and its derivatives for four observations in SIMD lanes, for functions marked
/// KYS_VECTOR_CLONES, which inline them.
struct CameraNumbers {
  double fx, fy, cx, cy, bf;

  explicit CameraNumbers(const StereoCamera& c)
      : fx(c.fx), fy(c.fy), cx(c.cx), cy(c.cy), bf(c.bf()) {}
};

/// Measurements of four observations. Weights are in 1/px^2. They are zero in lanes past the end
/// and for the disparity of monocular observations.
struct MeasuredLanes {
  Lanes u{}, v{}, u_right{};           // px
  Lanes weight{}, weight_disparity{};  // of u, and of the disparity
  Lanes ratio_v{};                     // weight of v over that of u
  Lanes bound{};  // chi2 that separates outliers, and the square of Huber's delta
};

/// Reprojection errors of four points (x, y, z) in the camera frame.
struct LaneErrors {
  Lanes x, y, z, inverse, derivative, du, dv, dd, chi2;
};

KYS_ALWAYS_INLINE void errors_of(const MeasuredLanes& o, const CameraNumbers& camera,
                                 LaneErrors& e) {
  // The same continuation below kMinDepth as InverseDepth.
  constexpr double kTop = 1.0 / kMinDepth;
  const LaneMask far = e.z >= kMinDepth;
  const Lanes reciprocal = 1.0 / (far ? e.z : broadcast(1.0));
  e.inverse = far ? reciprocal : 2.0 * kTop - e.z * (kTop * kTop);
  e.derivative = far ? -reciprocal * reciprocal : broadcast(-kTop * kTop);
  const Lanes u = camera.fx * e.x * e.inverse + camera.cx;
  e.du = u - o.u;
  e.dv = camera.fy * e.y * e.inverse + camera.cy - o.v;
  e.dd = camera.bf * e.inverse - (o.u - o.u_right);
  e.chi2 = o.weight * (e.du * e.du + o.ratio_v * e.dv * e.dv) + o.weight_disparity * e.dd * e.dd;
}

/// Huber's weight of each observation; its share of the cost (1/2 rho) is added to `cost`.
KYS_ALWAYS_INLINE Lanes huber_weight(const Lanes& bound, const Lanes& chi2, bool robust,
                                     const Lanes& active, Lanes& cost) {
  const LaneMask beyond = chi2 > bound;
  if (!robust || !any(beyond)) {
    cost += 0.5 * active * chi2;
    return active;
  }
  const Lanes root = sqrt_lanes(beyond ? chi2 * bound : broadcast(1.0));
  cost += 0.5 * active * (beyond ? 2.0 * root - bound : chi2);
  return active * (beyond ? bound / root : broadcast(1.0));
}

/// J^T W J (its entry 10 is zero) and J^T W r over the point in the camera frame, the weights of
/// the observations times `robust`.
struct LaneNormal {
  Lanes a00, a02, a11, a12, a22;
  Lanes g0, g1, g2;
};

KYS_ALWAYS_INLINE void normal_of(const LaneErrors& e, const CameraNumbers& camera,
                                 const MeasuredLanes& o, const Lanes& robust, LaneNormal& n) {
  const Lanes w = robust * o.weight;
  const Lanes w_disparity = robust * o.weight_disparity;
  // d(u,v,disparity)/dp_c = [a 0 b; 0 c d; 0 0 f]
  const Lanes a = camera.fx * e.inverse;
  const Lanes b = camera.fx * e.x * e.derivative;
  const Lanes c = camera.fy * e.inverse;
  const Lanes d = camera.fy * e.y * e.derivative;
  const Lanes f = camera.bf * e.derivative;
  const Lanes wa = w * a;
  const Lanes wc = w * o.ratio_v * c;
  const Lanes rd = o.ratio_v * d;
  n.a00 = wa * a;
  n.a02 = wa * b;
  n.a11 = wc * c;
  n.a12 = wc * d;
  n.a22 = w * (b * b + rd * d) + w_disparity * f * f;
  n.g0 = wa * e.du;
  n.g1 = wc * e.dv;
  n.g2 = w * (b * e.du + rd * e.dv) + w_disparity * f * e.dd;
}

/// Hessian and gradient over the left increment, p_c -> exp(w) p_c + v, which has the sparsest
/// Jacobian: dp_c/d[w v] = [-hat(p) I].
struct LanePoseNormal {
  Lanes b00, b01, b02, b10, b11, b12, b20, b21, b22;  // hat(p) A: rows of w, columns of v
  Lanes h00, h10, h11, h20, h21, h22;                 // hat(p) A hat(p)^T
  Lanes g0, g1, g2;                                   // of w; of v it is that of the point
};

KYS_ALWAYS_INLINE void pose_normal_of(const LaneErrors& e, const LaneNormal& n, LanePoseNormal& p) {
  p.b00 = e.y * n.a02;
  p.b01 = e.y * n.a12 - e.z * n.a11;
  p.b02 = e.y * n.a22 - e.z * n.a12;
  p.b10 = e.z * n.a00 - e.x * n.a02;
  p.b11 = -e.x * n.a12;
  p.b12 = e.z * n.a02 - e.x * n.a22;
  p.b20 = -e.y * n.a00;
  p.b21 = e.x * n.a11;
  p.b22 = e.x * n.a12 - e.y * n.a02;
  p.h00 = p.b02 * e.y - p.b01 * e.z;
  p.h10 = p.b12 * e.y - p.b11 * e.z;
  p.h11 = p.b10 * e.z - p.b12 * e.x;
  p.h20 = p.b22 * e.y - p.b21 * e.z;
  p.h21 = p.b20 * e.z - p.b22 * e.x;
  p.h22 = p.b21 * e.x - p.b20 * e.y;
  p.g0 = e.y * n.g2 - e.z * n.g1;
  p.g1 = e.z * n.g0 - e.x * n.g2;
  p.g2 = e.x * n.g1 - e.y * n.g0;
}

}  // namespace kys_slam
