// SPDX-License-Identifier: BSD-3-Clause
#include "optimization/schur_kernels.h"

namespace kys_slam::schur {
namespace {

// Columns of six as four and two, at any multiple of 8 bytes. The attributes follow the names:
// behind the type Clang ignores an alignment below the natural one.
using Four __attribute__((vector_size(32), aligned(8), may_alias)) = double;
using Two __attribute__((vector_size(16), aligned(8), may_alias)) = double;
static_assert(alignof(Four) == 8 && alignof(Two) == 8);

/// S -= a b^T for column-major 6x3 a, b and 6x6 S.
KYS_ALWAYS_INLINE void subtract_outer(const double* a, const double* b, double* S) {
  const Lanes a0 = *reinterpret_cast<const Four*>(a);
  const Lanes a1 = *reinterpret_cast<const Four*>(a + 6);
  const Lanes a2 = *reinterpret_cast<const Four*>(a + 12);
  const Two t0 = *reinterpret_cast<const Two*>(a + 4);
  const Two t1 = *reinterpret_cast<const Two*>(a + 10);
  const Two t2 = *reinterpret_cast<const Two*>(a + 16);
  for (int col = 0; col < 6; ++col) {
    Four& top = *reinterpret_cast<Four*>(S + 6 * col);
    Two& bottom = *reinterpret_cast<Two*>(S + 6 * col + 4);
    top -= a0 * b[col] + a1 * b[col + 6] + a2 * b[col + 12];
    bottom -= t0 * b[col] + t1 * b[col + 6] + t2 * b[col + 12];
  }
}

/// Takes the products Z_row Z_col^T of one point's observations off the reduced system, but for
/// those of an observation with itself.
KYS_ALWAYS_INLINE void subtract_products(const std::int32_t* free, const Matrix63* Z,
                                         std::int32_t count, const BlockPlaces& places,
                                         Matrix6d* reduced) {
  for (std::int32_t row = 1; row < count; ++row) {
    const std::int32_t r = free[row];
    for (std::int32_t col = 0; col < row; ++col) {
      const std::int32_t c = free[col];
      double* S = reduced[places(r, c)].data();
      subtract_outer(Z[row].data(), Z[col].data(), S);
      // A point seen twice from one pose gives that pose's block both triangles.
      if (c == r) subtract_outer(Z[col].data(), Z[row].data(), S);
    }
  }
}

/// Rows to columns.
KYS_ALWAYS_INLINE void transpose(Lanes& a, Lanes& b, Lanes& c, Lanes& d) {
  const Lanes ab0 = __builtin_shufflevector(a, b, 0, 4, 2, 6);
  const Lanes ab1 = __builtin_shufflevector(a, b, 1, 5, 3, 7);
  const Lanes cd0 = __builtin_shufflevector(c, d, 0, 4, 2, 6);
  const Lanes cd1 = __builtin_shufflevector(c, d, 1, 5, 3, 7);
  a = __builtin_shufflevector(ab0, cd0, 0, 1, 4, 5);
  b = __builtin_shufflevector(ab1, cd1, 0, 1, 4, 5);
  c = __builtin_shufflevector(ab0, cd0, 2, 3, 6, 7);
  d = __builtin_shufflevector(ab1, cd1, 2, 3, 6, 7);
}

/// Poses of four observations, [R|t] as lanes, and their errors.
struct LaneView {
  MeasuredLanes measured;
  Lanes T[12];
  LaneErrors errors;
};

KYS_ALWAYS_INLINE Lanes widen(const ObservationLanes::Floats& from) {
  float __attribute__((vector_size(16))) lanes;
  __builtin_memcpy(&lanes, from.data(), sizeof lanes);
  return __builtin_convertvector(lanes, Lanes);
}

KYS_ALWAYS_INLINE void look(const ObservationLanes& o, const View& view, const PointView& point,
                            LaneView& to) {
  MeasuredLanes& m = to.measured;
  m.u = widen(o.u);
  m.v = widen(o.v);
  m.u_right = widen(o.u_right);
  const Lanes inv_sigma = widen(o.inv_sigma);
  const Lanes share = broadcast(point.share);
  const LaneMask stereo = m.u_right == m.u_right;
  m.u_right = stereo ? m.u_right : broadcast(0);
  // Errors and their bound shrink together: the kernel acts as on the unweighted error.
  m.weight = share * (inv_sigma * inv_sigma);
  m.ratio_v = broadcast(view.ratio_v);
  m.weight_disparity = m.weight * (stereo ? broadcast(view.ratio_disparity) : broadcast(0));
  m.bound = share * (stereo ? broadcast(view.chi2_stereo) : broadcast(view.chi2_mono));
  for (int row = 0; row < 3; ++row) {
    Lanes* T = to.T + 4 * row;
    for (int k = 0; k < kLanes; ++k) {
      T[k] = *reinterpret_cast<const Four*>(view.poses[o.pose[k]].rows.data() + 4 * row);
    }
    transpose(T[0], T[1], T[2], T[3]);
  }
  const double* p_w = point.p_w;
  to.errors.x = to.T[0] * p_w[0] + to.T[1] * p_w[1] + to.T[2] * p_w[2] + to.T[3];
  to.errors.y = to.T[4] * p_w[0] + to.T[5] * p_w[1] + to.T[6] * p_w[2] + to.T[7];
  to.errors.z = to.T[8] * p_w[0] + to.T[9] * p_w[1] + to.T[10] * p_w[2] + to.T[11];
  errors_of(to.measured, view.camera, to.errors);
}

KYS_ALWAYS_INLINE bool all_fixed(const std::int32_t* free) {
  return (free[0] & free[1] & free[2] & free[3]) < 0;  // the sign of all
}

KYS_ALWAYS_INLINE void add_cost(const LaneView& v, bool robust, Lanes& cost) {
  static_cast<void>(huber_weight(v.measured.bound, v.errors.chi2, robust, broadcast(1), cost));
}

/// Per lane: the same, and of one group A R, with A = J^T W J over the camera frame.
struct PointLanes {
  Lanes V[6]{};
  Lanes b[3]{};
  Lanes AR[9];

  KYS_ALWAYS_INLINE void add(const Lanes* T, const LaneNormal& n) {
    for (int c = 0; c < 3; ++c) {
      AR[c] = n.a00 * T[c] + n.a02 * T[8 + c];
      AR[3 + c] = n.a11 * T[4 + c] + n.a12 * T[8 + c];
      AR[6 + c] = n.a02 * T[c] + n.a12 * T[4 + c] + n.a22 * T[8 + c];
      b[c] += T[c] * n.g0 + T[4 + c] * n.g1 + T[8 + c] * n.g2;
    }
    for (int r = 0, k = 0; r < 3; ++r) {
      for (int c = 0; c <= r; ++c, ++k) {
        V[k] += T[r] * AR[c] + T[4 + r] * AR[3 + c] + T[8 + r] * AR[6 + c];
      }
    }
  }
  KYS_ALWAYS_INLINE void sum_up(PointNormal& to) const {
    for (int k = 0; k < 6; ++k) to.V[k] = lane_sum(V[k]);
    for (int k = 0; k < 3; ++k) to.b[k] = lane_sum(b[k]);
  }
};

KYS_ALWAYS_INLINE void normal_in_view(const View& view, const LaneView& v, LaneNormal& n) {
  const MeasuredLanes& o = v.measured;
  Lanes cost{};
  const Lanes w = huber_weight(o.bound, v.errors.chi2, view.robust, broadcast(1), cost);
  normal_of(v.errors, view.camera, o, w, n);
}

/// Writes `kCount` lanes as numbers in a row, for each of four observations.
template <int kCount>
KYS_ALWAYS_INLINE void to_rows(const Lanes* lanes, double (*rows)[kCount]) {
  static_assert(kCount % kLanes == 0);
  for (int k = 0; k < kCount; k += kLanes) {
    Lanes a = lanes[k], b = lanes[k + 1], c = lanes[k + 2], d = lanes[k + 3];
    transpose(a, b, c, d);
    *reinterpret_cast<Four*>(rows[0] + k) = a;
    *reinterpret_cast<Four*>(rows[1] + k) = b;
    *reinterpret_cast<Four*>(rows[2] + k) = c;
    *reinterpret_cast<Four*>(rows[3] + k) = d;
  }
}

KYS_ALWAYS_INLINE void add_in_row(const double* from, int count, double* to) {
  for (int k = 0; k < count; k += kLanes) {
    Four& sum = *reinterpret_cast<Four*>(to + k);
    sum += *reinterpret_cast<const Four*>(from + k);
  }
}

}  // namespace

KYS_VECTOR_CLONES double cost_of(const ObservationLanes* groups, std::int32_t count,
                                 const View& view, const PointView& point) {
  Lanes cost{};
  for (std::int32_t g = 0; g < count; ++g) {
    LaneView v;
    look(groups[g], view, point, v);
    add_cost(v, view.robust, cost);
  }
  return lane_sum(cost);
}

KYS_VECTOR_CLONES void point_normal_of(const ObservationLanes* groups, std::int32_t count,
                                       const View& view, const PointView& point,
                                       PointNormal& normal) {
  PointLanes sums;
  for (std::int32_t g = 0; g < count; ++g) {
    LaneView v;
    look(groups[g], view, point, v);
    LaneNormal n;
    normal_in_view(view, v, n);
    sums.add(v.T, n);
  }
  sums.sum_up(normal);
}

KYS_VECTOR_CLONES void linearise(const ObservationLanes* groups, const std::int32_t* free,
                                 std::int32_t count, const View& view, const PointView& point,
                                 MixedLanes* mixed, PointNormal& normal) {
  PointLanes sums;
  for (std::int32_t g = 0; g < count; ++g) {
    const ObservationLanes& o = groups[g];
    LaneView v;
    look(o, view, point, v);
    LaneNormal n;
    normal_in_view(view, v, n);
    sums.add(v.T, n);
    if (all_fixed(free + kLanes * g)) continue;
    LanePoseNormal p;
    pose_normal_of(v.errors, n, p);
    const Lanes zero{};
    const Lanes pose[36] = {p.h00, p.h10, p.h20, p.b00, p.b01, p.b02,  //
                            p.h10, p.h11, p.h21, p.b10, p.b11, p.b12,  //
                            p.h20, p.h21, p.h22, p.b20, p.b21, p.b22,  //
                            p.b00, p.b10, p.b20, n.a00, zero,  n.a02,  //
                            p.b01, p.b11, p.b21, zero,  n.a11, n.a12,  //
                            p.b02, p.b12, p.b22, n.a02, n.a12, n.a22};
    for (int k = 0; k < 36; ++k) mixed[g].pose[k] = pose[k];
    const Lanes* AR = sums.AR;
    const LaneErrors& e = v.errors;
    for (int c = 0; c < 3; ++c) {
      Lanes* column = mixed[g].block + 6 * c;
      column[0] = e.y * AR[6 + c] - e.z * AR[3 + c];
      column[1] = e.z * AR[c] - e.x * AR[6 + c];
      column[2] = e.x * AR[3 + c] - e.y * AR[c];
      column[3] = AR[c];
      column[4] = AR[3 + c];
      column[5] = AR[6 + c];
    }
    const Lanes gradient[6] = {p.g0, p.g1, p.g2, n.g0, n.g1, n.g2};
    for (int k = 0; k < 6; ++k) mixed[g].gradient[k] = gradient[k];
  }
  sums.sum_up(normal);
}

KYS_VECTOR_CLONES void eliminate(const std::int32_t* free, std::int32_t count,
                                 const MixedLanes* mixed, const double* L_inverse, const double* y,
                                 Matrix63* Z, const ReducedSystem& system) {
  for (std::int32_t begin = 0; begin < count; begin += kLanes) {
    const std::int32_t* here = free + begin;
    const std::int32_t g = begin / kLanes;
    if (all_fixed(here)) continue;
    const Lanes* m = mixed[g].block;
    Lanes z[20];
    Lanes sums[16];  // gradient, diagonal
    for (int r = 0; r < 6; ++r) {
      z[r] = m[r] * L_inverse[0];
      z[6 + r] = m[r] * L_inverse[1] + m[6 + r] * L_inverse[2];
      z[12 + r] = m[r] * L_inverse[3] + m[6 + r] * L_inverse[4] + m[12 + r] * L_inverse[5];
      sums[r] = mixed[g].gradient[r] - (z[r] * y[0] + z[6 + r] * y[1] + z[12 + r] * y[2]);
      sums[8 + r] = mixed[g].pose[7 * r];
    }
    z[18] = z[19] = sums[6] = sums[7] = sums[14] = sums[15] = Lanes{};
    Lanes pose[36];
    for (int c = 0; c < 6; ++c) {
      for (int r = c; r < 6; ++r) {
        const Lanes product = z[r] * z[c] + z[6 + r] * z[6 + c] + z[12 + r] * z[12 + c];
        pose[6 * c + r] = pose[6 * r + c] = mixed[g].pose[6 * c + r] - product;
      }
    }
    alignas(32) double z_rows[kLanes][20];
    alignas(32) double sum_rows[kLanes][16];
    alignas(32) double pose_rows[kLanes][36];
    to_rows<20>(z, z_rows);
    to_rows<16>(sums, sum_rows);
    to_rows<36>(pose, pose_rows);
    for (int k = 0; k < kLanes; ++k) {
      const std::int32_t r = here[k];
      if (r < 0) continue;
      __builtin_memcpy(Z[kLanes * g + k].data(), z_rows[k], 18 * sizeof(double));
      add_in_row(sum_rows[k], 16, system.sums[r].data());
      add_in_row(pose_rows[k], 36, system.blocks[(*system.places)(r, r)].data());
    }
  }
  std::int32_t first = 0;
  while (first < count && free[first] < 0) ++first;
  subtract_products(free + first, Z + first, count - first, *system.places, system.blocks);
}

KYS_VECTOR_CLONES void moved_gradient(const ObservationLanes* groups, std::int32_t count,
                                      const View& view, const PointView& point,
                                      const PoseStep* steps, double* gradient) {
  Lanes sum[3]{};
  for (std::int32_t g = 0; g < count; ++g) {
    const ObservationLanes& o = groups[g];
    std::int32_t free[kLanes];
    look_up_free(o, view, free);
    if (all_fixed(free)) continue;
    LaneView v;
    look(o, view, point, v);
    LaneNormal n;
    normal_in_view(view, v, n);
    Lanes w[4], t[4];  // turn and shift, interleaved with what is not used
    for (int k = 0; k < kLanes; ++k) {
      const double* step = steps[free[k] + 1].data();
      w[k] = *reinterpret_cast<const Four*>(step);
      t[k] = *reinterpret_cast<const Four*>(step + 4);
    }
    transpose(w[0], w[1], w[2], w[3]);
    transpose(t[0], t[1], t[2], t[3]);
    const LaneErrors& e = v.errors;
    const Lanes x = t[0] + (w[1] * e.z - w[2] * e.y);
    const Lanes y = t[1] + (w[2] * e.x - w[0] * e.z);
    const Lanes z = t[2] + (w[0] * e.y - w[1] * e.x);
    const Lanes g0 = n.a00 * x + n.a02 * z;
    const Lanes g1 = n.a11 * y + n.a12 * z;
    const Lanes g2 = n.a02 * x + n.a12 * y + n.a22 * z;
    for (int c = 0; c < 3; ++c) sum[c] += v.T[c] * g0 + v.T[4 + c] * g1 + v.T[8 + c] * g2;
  }
  for (int c = 0; c < 3; ++c) gradient[c] = lane_sum(sum[c]);
}

}  // namespace kys_slam::schur
