// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <variant>

#include "util/lanes.h"

namespace kys_slam {

/// The flow (px) a static scene has along one row of the image: at column x (px) and inverse depth
/// rho (1/m). This one is for the exact rigid motion: next position minus present position.
struct Se3FlowRow {
  float ux, u0, ut;  ///< next column times depth ratio: ux x + u0 + ut rho
  float vx, v0, vt;  ///< next row times depth ratio
  float zx, z0, zt;  ///< depth ratio, next over now
  float cx, cy;      ///< px, principal point; cy from this row

  KYS_ALWAYS_INLINE void at(float x, float rho, float& u, float& v) const {
    constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
    const float ratio = zx * x + z0 + zt * rho;
    // A static point that would be behind the camera has no place in the next image.
    const float inverse = ratio > 1e-3F ? 1.0F / ratio : kNothing;
    u = (ux * x + u0 + ut * rho) * inverse + (cx - x);
    v = (vx * x + v0 + vt * rho) * inverse + cy;
  }
};

/// The same for the two models of eight parameters.
struct LinearFlowRow {
  float inverse_width;
  float u0, ux, uxx, ur, urx;  ///< u = u0 + ux x + uxx x^2 + rho (ur + urx x), x in -0.5..0.5
  float v0, vx, vr;            ///< v = v0 + vx x + rho vr

  KYS_ALWAYS_INLINE void at(float column, float rho, float& u, float& v) const {
    const float x = column * inverse_width - 0.5F;
    u = u0 + x * (ux + uxx * x) + rho * (ur + urx * x);
    v = v0 + x * vx + rho * vr;
  }
};

using FlowRow = std::variant<Se3FlowRow, LinearFlowRow>;

}  // namespace kys_slam
