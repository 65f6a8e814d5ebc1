// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>

#include <array>

#include "optimization/reprojection_lanes.h"
#include "util/lanes.h"

namespace kys_slam {

/// std::array of lanes; templates drop the alignment that lanes are declared with.
template <int N>
struct LaneList {
  Lanes list[N];

  KYS_ALWAYS_INLINE Lanes& operator[](int k) { return list[k]; }
  KYS_ALWAYS_INLINE const Lanes& operator[](int k) const { return list[k]; }
};

/// Four matches of an instance in SIMD lanes, for the fits of instance_motion.cpp. Lanes past the
/// end have `active` 0 and are never NaN.
struct MatchLanes {
  Lanes qx{}, qy{}, qz{};                 // m, predicted position of a static point
  Lanes u{}, v{}, disparity{};            // px, observed now
  LaneList<6> sigma_q{};                  // m^2, of q: xx, xy, xz, yy, yz, zz
  Lanes sigma_u{}, sigma_v{}, sigma_d{};  // px^2, variances of what is observed
  LaneList<6> information{};              // 1/px^2, of the error: uu, uv, ud, vv, vd, dd
  Lanes active{};                         // 1, or 0 past the end
};

/// A rigid motion about a centre: x = R (q - c) + c + t.
struct MotionLanes {
  std::array<double, 9> R;  // row-major
  std::array<double, 3> centre, shift;
};

/// Four points moved by the motion, their errors (predicted minus observed, px), and the derivative
/// [a 0 b; 0 c d; 0 0 f] of the errors by the points.
struct MovedLanes {
  Lanes arm_x, arm_y, arm_z;  // m, R (q - c)
  LaneMask before;            // far enough in front of the camera
  Lanes du, dv, dd;
  Lanes a, b, c, d, f;
};

KYS_ALWAYS_INLINE void move(const MatchLanes& m, const MotionLanes& motion,
                            const CameraNumbers& camera, MovedLanes& p) {
  const std::array<double, 9>& R = motion.R;
  const Lanes x0 = m.qx - motion.centre[0];
  const Lanes y0 = m.qy - motion.centre[1];
  const Lanes z0 = m.qz - motion.centre[2];
  p.arm_x = R[0] * x0 + R[1] * y0 + R[2] * z0;
  p.arm_y = R[3] * x0 + R[4] * y0 + R[5] * z0;
  p.arm_z = R[6] * x0 + R[7] * y0 + R[8] * z0;
  const Lanes x = p.arm_x + (motion.centre[0] + motion.shift[0]);
  const Lanes y = p.arm_y + (motion.centre[1] + motion.shift[1]);
  const Lanes z = p.arm_z + (motion.centre[2] + motion.shift[2]);
  p.before = z >= kMinDepth;
  const Lanes inverse = 1.0 / (p.before ? z : broadcast(1.0));
  p.a = camera.fx * inverse;
  p.c = camera.fy * inverse;
  p.f = -camera.bf * inverse * inverse;
  p.du = p.a * x + camera.cx - m.u;
  p.dv = p.c * y + camera.cy - m.v;
  p.dd = camera.bf * inverse - m.disparity;
  p.b = -p.a * x * inverse;
  p.d = -p.c * y * inverse;
}

/// Inverse covariance of the errors, from the propagated covariance of q and that of the
/// observation.
KYS_ALWAYS_INLINE void weigh(MatchLanes& m, const MotionLanes& motion,
                             const CameraNumbers& camera) {
  MovedLanes p;
  move(m, motion, camera, p);
  const std::array<double, 9>& R = motion.R;
  LaneList<3> ju, jv, jd;  // rows of the derivative by q
  for (int k = 0; k < 3; ++k) {
    ju[k] = p.a * R[k] + p.b * R[6 + k];
    jv[k] = p.c * R[3 + k] + p.d * R[6 + k];
    jd[k] = p.f * R[6 + k];
  }
  const LaneList<6>& q = m.sigma_q;
  const auto times_sigma = [&q](const LaneList<3>& j) {
    return LaneList<3>{{q[0] * j[0] + q[1] * j[1] + q[2] * j[2],
                        q[1] * j[0] + q[3] * j[1] + q[4] * j[2],
                        q[2] * j[0] + q[4] * j[1] + q[5] * j[2]}};
  };
  const auto dot = [](const LaneList<3>& x, const LaneList<3>& y) {
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
  };
  const LaneList<3> su = times_sigma(ju);
  const LaneList<3> sv = times_sigma(jv);
  const Lanes uu = dot(ju, su) + m.sigma_u;
  const Lanes uv = dot(jv, su);
  const Lanes ud = dot(jd, su);
  const Lanes vv = dot(jv, sv) + m.sigma_v;
  const Lanes vd = dot(jd, sv);
  const Lanes dd = dot(jd, times_sigma(jd)) + m.sigma_d;
  // Adjugate over determinant.
  const Lanes c0 = vv * dd - vd * vd;
  const Lanes c1 = ud * vd - uv * dd;
  const Lanes c2 = uv * vd - ud * vv;
  const Lanes scale = 1.0 / (uu * c0 + uv * c1 + ud * c2);
  m.information = {{scale * c0, scale * c1, scale * c2, scale * (uu * dd - ud * ud),
                    scale * (uv * ud - uu * vd), scale * (uu * vv - uv * uv)}};
}

/// Sums over matches: Hessian and gradient of half the chi-squares below the truncation over [w; v]
/// (x -> exp(w) (x - c) + c + v), the truncated cost, and the number of inliers.
struct MatchSums {
  LaneList<6> ww{};  // 00, 01, 02, 11, 12, 22
  LaneList<9> wv{};  // rows of w, columns of v
  LaneList<6> vv{};
  LaneList<3> gw{}, gv{};
  Lanes cost{}, inliers{};
  LaneList<3> q{};  // sum of q over the inliers
};

/// \param soft Cauchy weights instead of truncation
KYS_ALWAYS_INLINE void add(const MatchLanes& m, const MotionLanes& motion,
                           const CameraNumbers& camera, double max_chi2, bool soft,
                           MatchSums& sums) {
  MovedLanes p;
  move(m, motion, camera, p);
  const LaneList<6>& W = m.information;
  // J^T W, row by row.
  const Lanes r00 = p.a * W[0];
  const Lanes r01 = p.a * W[1];
  const Lanes r02 = p.a * W[2];
  const Lanes r10 = p.c * W[1];
  const Lanes r11 = p.c * W[3];
  const Lanes r12 = p.c * W[4];
  const Lanes r20 = p.b * W[0] + p.d * W[1] + p.f * W[2];
  const Lanes r21 = p.b * W[1] + p.d * W[3] + p.f * W[4];
  const Lanes r22 = p.b * W[2] + p.d * W[4] + p.f * W[5];
  const Lanes We0 = W[0] * p.du + W[1] * p.dv + W[2] * p.dd;
  const Lanes We1 = W[1] * p.du + W[3] * p.dv + W[4] * p.dd;
  const Lanes We2 = W[2] * p.du + W[4] * p.dv + W[5] * p.dd;
  const Lanes chi2 = p.du * We0 + p.dv * We1 + p.dd * We2;
  const LaneMask fits = p.before & (chi2 <= max_chi2);
  const Lanes one = m.active;
  const Lanes none = broadcast(0.0);
  sums.cost += one * (fits ? chi2 : broadcast(max_chi2));
  const Lanes inlier = fits ? one : none;
  sums.inliers += inlier;
  sums.q[0] += inlier * m.qx;
  sums.q[1] += inlier * m.qy;
  sums.q[2] += inlier * m.qz;
  const Lanes w = soft ? (p.before ? one / (1.0 + chi2 / max_chi2) : none) : inlier;

  const Lanes m00 = w * r00 * p.a;
  const Lanes m01 = w * r01 * p.c;
  const Lanes m02 = w * (r00 * p.b + r01 * p.d + r02 * p.f);
  const Lanes m11 = w * r11 * p.c;
  const Lanes m12 = w * (r10 * p.b + r11 * p.d + r12 * p.f);
  const Lanes m22 = w * (r20 * p.b + r21 * p.d + r22 * p.f);
  const Lanes g0 = w * p.a * We0;
  const Lanes g1 = w * p.c * We1;
  const Lanes g2 = w * (p.b * We0 + p.d * We1 + p.f * We2);
  // From the point to the motion: dx/d[w v] = [-hat(arm) I].
  const Lanes x = p.arm_x;
  const Lanes y = p.arm_y;
  const Lanes z = p.arm_z;
  const Lanes h00 = y * m02 - z * m01;
  const Lanes h01 = y * m12 - z * m11;
  const Lanes h02 = y * m22 - z * m12;
  const Lanes h10 = z * m00 - x * m02;
  const Lanes h11 = z * m01 - x * m12;
  const Lanes h12 = z * m02 - x * m22;
  const Lanes h20 = x * m01 - y * m00;
  const Lanes h21 = x * m11 - y * m01;
  const Lanes h22 = x * m12 - y * m02;
  const LaneList<9> wv{{h00, h01, h02, h10, h11, h12, h20, h21, h22}};
  for (int k = 0; k < 9; ++k) sums.wv[k] += wv[k];
  sums.ww[0] += y * h02 - z * h01;
  sums.ww[1] += z * h00 - x * h02;
  sums.ww[2] += x * h01 - y * h00;
  sums.ww[3] += z * h10 - x * h12;
  sums.ww[4] += x * h11 - y * h10;
  sums.ww[5] += x * h21 - y * h20;
  const LaneList<6> vv{{m00, m01, m02, m11, m12, m22}};
  for (int k = 0; k < 6; ++k) sums.vv[k] += vv[k];
  sums.gw[0] += y * g2 - z * g1;
  sums.gw[1] += z * g0 - x * g2;
  sums.gw[2] += x * g1 - y * g0;
  sums.gv[0] += g0;
  sums.gv[1] += g1;
  sums.gv[2] += g2;
}

}  // namespace kys_slam
