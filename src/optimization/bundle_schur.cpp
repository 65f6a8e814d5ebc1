#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "geometry/so3.h"
#include "optimization/block_cholesky.h"
#include "optimization/bundle_solver.h"
#include "optimization/damping.h"
#include "optimization/reprojection_lanes.h"

// Levenberg-Marquardt on the normal equations of bundle adjustment with the points eliminated
// (Triggs et al., "Bundle adjustment: a modern synthesis", Sec. 6.1). The reduced system is dense
// for windows of few poses and sparse, by blocks, for whole maps; what comes before it is the same.
// The increment of a pose is that of the camera frame, p_c -> exp(w) p_c + v, which has the
// sparsest Jacobian. A point's blocks never leave the cache: its observations are linearised and
// eliminated in one go, and only what back-substitution needs is kept.

namespace kys_slam {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;

constexpr double kInitialDamping = 1e-4;
constexpr std::size_t kPointsBetweenStops = 4096;  // some ms
constexpr int kPointRounds = 2;
constexpr double kPointDamping = 1e-3;

/// Four observations of one point; lanes past its end weigh nothing. Whole maps have very many, so
/// they are kept as the floats they come from.
struct ObservationLanes {
  using Floats = std::array<float, kLanes>;
  Floats u{}, v{}, u_right{};  // px; NaN where there is no u_right
  Floats inv_sigma{};          // 1/px
  std::array<std::int32_t, kLanes> pose{};
};

/// One point: its observations [begin, end) in order, its groups of four from `group` on.
struct SchurPoint {
  std::int32_t point;
  std::int32_t begin;
  std::int32_t end;
  std::int32_t group;

  [[nodiscard]] std::int32_t groups() const { return (end - begin + kLanes - 1) / kLanes; }
};

/// What back-substitution and the gain ratio need of an eliminated point. Windows keep it; whole
/// maps compute it again.
struct EliminatedPoint {
  std::array<double, 6> L_inverse;  // of the Cholesky factor of V + damping: lower triangle by rows
  Eigen::Vector3d b;                // J^T W r
  Eigen::Vector3d damping;          // what was added to the diagonal of V
};

/// [R|t], row by row.
struct PoseMatrix {
  alignas(32) std::array<double, 12> rows;
};

/// Where the blocks of the lower triangle of the reduced system are, row by row: all of them, or
/// those of poses that share a point.
class BlockPlaces {
 public:
  BlockPlaces() = default;
  explicit BlockPlaces(const BlockPattern& pattern)
      : first_(pattern.rows()), begin_(pattern.rows()) {
    for (std::int32_t r = 0; r < pattern.rows(); ++r) {
      // From the row's first block to the diagonal, gaps included.
      const std::int32_t* column = pattern.column.data();
      first_[r] = column[pattern.row_begin[r]];
      begin_[r] = place_.size();
      place_.resize(place_.size() + static_cast<std::size_t>(r - first_[r]) + 1, -1);
      for (std::int32_t k = pattern.row_begin[r]; k < pattern.row_begin[r + 1]; ++k) {
        place_[begin_[r] + static_cast<std::size_t>(column[k] - first_[r])] = k;
      }
    }
  }
  [[nodiscard]] std::int32_t operator()(std::int32_t row, std::int32_t col) const {
    return place_[begin_[row] + static_cast<std::size_t>(col - first_[row])];
  }

 private:
  std::vector<std::int32_t> first_;
  std::vector<std::size_t> begin_;
  std::vector<std::int32_t> place_;
};

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

/// What every point is looked at with. Of the poses, one more than there are: lanes past the end of
/// a point have that.
struct View {
  CameraNumbers camera;
  const PoseMatrix* poses;
  const std::int32_t* free;  // per pose: its place among the free ones, or -1
  bool robust;
  double disparity_weight, chi2_mono, chi2_stereo;
};

/// A point that is looked at.
struct PointView {
  const double* p_w;
  double share;  // factor on the information of its observations
};

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
  m.weight_disparity = m.weight * (stereo ? broadcast(view.disparity_weight) : broadcast(0));
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

/// Places of four poses among the free ones.
KYS_ALWAYS_INLINE void look_up_free(const ObservationLanes& o, const View& view,
                                    std::int32_t* free) {
  for (int k = 0; k < kLanes; ++k) free[k] = view.free[o.pose[k]];
}

KYS_ALWAYS_INLINE bool all_fixed(const std::int32_t* free) {
  return (free[0] & free[1] & free[2] & free[3]) < 0;  // the sign of all
}

KYS_ALWAYS_INLINE void add_cost(const LaneView& v, bool robust, Lanes& cost) {
  static_cast<void>(huber_weight(v.measured.bound, v.errors.chi2, robust, broadcast(1), cost));
}

/// 1/2 the sum of rho over a point's observations.
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

/// J^T W J (lower triangle, row by row) and J^T W r over a point.
struct PointNormal {
  double V[6];
  double b[3];
};

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
  normal_of(v.errors, view.camera, w * o.weight, w * o.weight_disparity, n);
}

/// Of a point, the poses held.
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

/// Of a pose: its gradient (6 numbers and 2 that are not used), then the diagonal of its block
/// before points are eliminated (the same).
struct PoseSums {
  alignas(32) std::array<double, 16> numbers{};

  [[nodiscard]] double* data() { return numbers.data(); }
  [[nodiscard]] Eigen::Map<Vector6d> gradient() { return Eigen::Map<Vector6d>(numbers.data()); }
  [[nodiscard]] Eigen::Map<Vector6d> diagonal() { return Eigen::Map<Vector6d>(numbers.data() + 8); }
};

/// Step of a pose: turn, 0, shift, 0.
struct PoseStep {
  alignas(32) std::array<double, 8> numbers{};

  [[nodiscard]] const double* data() const { return numbers.data(); }
};

/// Where the parts of the reduced system lie.
struct ReducedSystem {
  Matrix6d* blocks;
  const BlockPlaces* places;
  PoseSums* sums;
};

/// Of four observations: the blocks of their poses, their mixed blocks (pose rows, point columns,
/// column by column), their gradients.
struct MixedLanes {
  Lanes pose[36];
  Lanes block[18];
  Lanes gradient[6];
};

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

/// Linearises a point's observations and sums up the point's own part.
/// \param free per lane, the place of its pose among the free ones, or -1
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

/// Adds a linearised point's observations to the reduced system and takes the point out of it:
/// Z = mixed L^-T of each of them.
/// \param free as of linearise
/// \param L_inverse 00, 10, 11, 20, 21, 22
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

/// Sum of the mixed blocks' transposes times the steps of the poses: what these steps mean for a
/// point's gradient. Made anew rather than kept from the linearisation: the mixed blocks of a whole
/// map are the largest thing there would be to keep.
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

class SchurBundle {
 public:
  SchurBundle(BundleProblem& problem, const BundleOptions& options, const BundleRound& round)
      : problem_(problem),
        options_(options),
        view_{CameraNumbers(problem.camera),
              nullptr,
              nullptr,
              round.robust,
              options.disparity_weight,
              options.chi2_mono,
              options.chi2_stereo} {
    number_free_poses(round);
    sort_observations(round);
    const BlockPattern pattern = round.sparse ? shared_points() : all_blocks();
    places_ = BlockPlaces(pattern);
    if (round.sparse) sparse_.emplace(pattern);
    reduced_.resize(pattern.column.size());
    sums_.resize(free_pose_.size());
    lane_steps_.resize(free_pose_.size() + 1);
    pose_damping_.resize(free_pose_.size());
    pose_step_.resize(free_pose_.size());
    if (!round.sparse) eliminated_.resize(points_.size());
    other_points_.resize(points_.size());
    const auto size = static_cast<Eigen::Index>(6 * free_pose_.size());
    if (!round.sparse) dense_.resize(size, size);
    flat_gradient_.resize(size);
  }

  BundleRoundSummary solve(int iterations) {
    BundleRoundSummary summary;
    update_matrices();
    double cost = evaluate();
    summary.initial_cost = summary.final_cost = cost;
    if (points_.empty()) return summary;
    Damping damping(kInitialDamping);
    while (summary.iterations < iterations && !damping.exhausted()) {
      if (should_stop()) {
        summary.stopped = true;
        break;
      }
      ++summary.iterations;
      const double predicted = step(damping.value());
      if (stopped_) {  // nothing has moved
        summary.stopped = true;
        break;
      }
      if (!(predicted >= 0)) {  // no factorisation, or NaN
        damping.refuse();
        continue;
      }
      if (predicted <= 1e-3 * options_.function_tolerance * cost) break;
      if (sparse_) iterate_points();
      const double candidate = evaluate();
      const double decrease = cost - candidate;
      const double gain = decrease / predicted;
      if (gain > Damping::kMinGain) {
        const bool converged = decrease <= options_.function_tolerance * cost;
        cost = candidate;
        damping.accept(gain);
        if (converged) break;
      } else {
        restore();
        if (std::abs(decrease) <= options_.function_tolerance * cost) break;
        damping.refuse();
      }
    }
    summary.final_cost = cost;
    return summary;
  }

 private:
  [[nodiscard]] bool should_stop() const {
    return options_.stop != nullptr && options_.stop->load(std::memory_order_relaxed);
  }

  void number_free_poses(const BundleRound& round) {
    std::vector<std::uint8_t> used(problem_.T_c_w.size(), 0);
    for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
      if (round.active[i] != 0) used[problem_.observations[i].pose] = 1;
    }
    free_index_.assign(problem_.T_c_w.size() + 1, -1);
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i] == 0 || round.pose_fixed[i] != 0) continue;
      free_index_[i] = static_cast<std::int32_t>(free_pose_.size());
      free_pose_.push_back(static_cast<std::int32_t>(i));
    }
    view_.free = free_index_.data();
  }

  /// Groups the active observations by point (counting sort) and orders those of a point by free
  /// pose, so that sums run in the same order however the caller listed them per pose.
  void sort_observations(const BundleRound& round) {
    std::vector<std::int32_t> first(problem_.points.size() + 1, 0);
    const auto& all = problem_.observations;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (round.active[i] != 0) ++first[all[i].point + 1];
    }
    for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
    std::vector<std::int32_t> order(static_cast<std::size_t>(first.back()));
    std::vector<std::int32_t> next(first.begin(), first.end() - 1);
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (round.active[i] != 0) order[next[all[i].point]++] = static_cast<std::int32_t>(i);
    }
    const auto free_of = [&](std::int32_t i) { return free_index_[all[i].pose]; };
    const auto earlier = [&](std::int32_t a, std::int32_t b) { return free_of(a) < free_of(b); };
    std::int32_t groups = 0;
    std::int32_t most = 0;
    for (std::size_t i = 0; i + 1 < first.size(); ++i) {
      if (first[i + 1] == first[i]) continue;
      const auto begin = order.begin() + first[i];
      const auto end = order.begin() + first[i + 1];
      if (!std::is_sorted(begin, end, earlier)) std::stable_sort(begin, end, earlier);
      points_.push_back({static_cast<std::int32_t>(i), first[i], first[i + 1], groups});
      groups += points_.back().groups();
      most = std::max(most, points_.back().groups());
    }
    mixed_.resize(static_cast<std::size_t>(most));
    Z_.resize(static_cast<std::size_t>(kLanes * most));
    free_.resize(Z_.size());
    ObservationLanes none;
    none.pose.fill(static_cast<std::int32_t>(problem_.T_c_w.size()));
    groups_.resize(static_cast<std::size_t>(groups), none);
    for (const SchurPoint& p : points_) {
      for (std::int32_t k = 0; k < p.end - p.begin; ++k) {
        pack(all[order[p.begin + k]], k % kLanes, groups_[p.group + k / kLanes]);
      }
    }
  }

  [[nodiscard]] BlockPattern all_blocks() const {
    BlockPattern pattern;
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t c = 0; c <= r; ++c) pattern.column.push_back(c);
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  /// Blocks of poses that see a point together.
  [[nodiscard]] BlockPattern shared_points() const {
    std::vector<std::int32_t> free_of;  // per observation, by point
    if (!points_.empty()) free_of.reserve(static_cast<std::size_t>(points_.back().end));
    for (const SchurPoint& p : points_) {
      for (std::int32_t i = 0; i < p.end - p.begin; ++i) {
        free_of.push_back(free_index_[groups_[p.group + i / kLanes].pose[i % kLanes]]);
      }
    }
    // Observations by free pose, so that a row is finished before the next.
    std::vector<std::int32_t> begin(free_pose_.size() + 1, 0);
    for (const std::int32_t r : free_of) {
      if (r >= 0) ++begin[r + 1];
    }
    for (std::size_t r = 1; r < begin.size(); ++r) begin[r] += begin[r - 1];
    std::vector<std::int32_t> point_of(static_cast<std::size_t>(begin.back()));
    std::vector<std::int32_t> next(begin.begin(), begin.end() - 1);
    for (std::size_t k = 0; k < points_.size(); ++k) {
      for (std::int32_t i = points_[k].begin; i < points_[k].end; ++i) {
        const std::int32_t r = free_of[i];
        if (r >= 0) point_of[next[r]++] = static_cast<std::int32_t>(k);
      }
    }
    BlockPattern pattern;
    std::vector<std::int32_t> seen_by(free_pose_.size(), -1);
    for (std::int32_t r = 0; r < static_cast<std::int32_t>(free_pose_.size()); ++r) {
      for (std::int32_t k = begin[r]; k < begin[r + 1]; ++k) {
        const SchurPoint& point = points_[point_of[k]];
        for (std::int32_t i = point.begin; i < point.end; ++i) {
          const std::int32_t c = free_of[i];
          if (c > r) break;
          if (c < 0 || seen_by[c] == r) continue;
          seen_by[c] = r;
          pattern.column.push_back(c);
        }
      }
      std::sort(pattern.column.begin() + pattern.row_begin.back(), pattern.column.end());
      pattern.row_begin.push_back(static_cast<std::int32_t>(pattern.column.size()));
    }
    return pattern;
  }

  static void pack(const BundleProblem::Observation& o, int lane, ObservationLanes& to) {
    to.u[lane] = o.u;
    to.v[lane] = o.v;
    to.u_right[lane] = o.u_right;
    to.inv_sigma[lane] = o.inv_sigma;
    to.pose[lane] = o.pose;
  }

  void update_matrices() {
    matrices_.resize(problem_.T_c_w.size() + 1);
    for (std::size_t i = 0; i < problem_.T_c_w.size(); ++i) {
      using RowMajor = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
      Eigen::Map<RowMajor>(matrices_[i].rows.data()) = problem_.T_c_w[i].matrix();
    }
    matrices_.back() = matrices_.front();
    view_.poses = matrices_.data();
  }

  [[nodiscard]] PointView view_of(const SchurPoint& point, const Eigen::Vector3d& p_w) const {
    return {p_w.data(), problem_.weights.empty() ? 1 : problem_.weights[point.point]};
  }
  [[nodiscard]] PointView view_of(const SchurPoint& point) const {
    return view_of(point, problem_.points[point.point]);
  }

  /// 1/2 the sum of rho over the point's observations, the point being at p_w.
  [[nodiscard]] double loss(const SchurPoint& point, const Eigen::Vector3d& p_w) const {
    return cost_of(groups_.data() + point.group, point.groups(), view_, view_of(point, p_w));
  }

  /// At the present poses and points.
  [[nodiscard]] double evaluate() const {
    double cost = 0;
    for (const SchurPoint& point : points_) cost += loss(point, problem_.points[point.point]);
    return cost;
  }

  /// After a step, every point by itself goes where the moved poses see it best (Jeong et al.,
  /// "Pushing the envelope of modern methods for bundle adjustment", 2012, Sec. 4: embedded point
  /// iterations). The linear model is poor for the few points of little parallax; without this they
  /// get steps refused that were good for all others.
  void iterate_points() {
    for (std::size_t k = 0; k < points_.size(); ++k) {
      if (k % kPointsBetweenStops == 0 && should_stop()) return;
      Eigen::Vector3d& p_w = problem_.points[points_[k].point];
      double cost = loss(points_[k], p_w);
      if (const double before = loss(points_[k], other_points_[k]); before < cost) {
        p_w = other_points_[k];
        cost = before;
      }
      for (int round = 0; round < kPointRounds; ++round) {
        const Eigen::Vector3d moved = p_w + point_newton_step(points_[k], p_w);
        const double after = loss(points_[k], moved);
        if (!(after < cost)) break;
        p_w = moved;
        cost = after;
      }
    }
  }

  /// Gauss-Newton step of one point, the poses held.
  [[nodiscard]] Eigen::Vector3d point_newton_step(const SchurPoint& point,
                                                  const Eigen::Vector3d& p_w) const {
    PointNormal normal;
    point_normal_of(groups_.data() + point.group, point.groups(), view_, view_of(point, p_w),
                    normal);
    Eigen::Matrix3d V = lower_of(normal.V);
    const Eigen::Vector3d b(normal.b);
    V.diagonal() += kPointDamping * V.diagonal().cwiseMax(Damping::kMinDiagonal);
    const Eigen::Matrix3d L_inverse = inverse_of_cholesky(V);
    return -(L_inverse.transpose() * (L_inverse * b));
  }

  Matrix6d& block(std::int32_t row, std::int32_t col) { return reduced_[places_(row, col)]; }

  /// Linearises and eliminates every point, solves, and moves poses and points. Returns the
  /// decrease of the cost that the linear model predicts, or a negative number or NaN if there is
  /// no such step (nothing has moved then).
  double step(double damping) {
    for (Matrix6d& m : reduced_) m.setZero();
    sums_.assign(sums_.size(), {});
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (i % kPointsBetweenStops == 0 && should_stop()) {
        stopped_ = true;
        return -1;
      }
      take_in(i, damping);
    }
    if (!solve_reduced(damping)) return -1;
    const double predicted = back_substitute(damping);
    if (std::isfinite(predicted) && predicted >= 0) apply();
    return predicted;
  }

  /// Adds a point's observations to the reduced system.
  void take_in(std::size_t index, double damping) {
    const SchurPoint& point = points_[index];
    const ReducedSystem system{reduced_.data(), &places_, sums_.data()};
    const ObservationLanes* groups = groups_.data() + point.group;
    for (std::int32_t g = 0; g < point.groups(); ++g) {
      look_up_free(groups[g], view_, free_.data() + kLanes * g);
    }
    PointNormal normal;
    linearise(groups, free_.data(), point.groups(), view_, view_of(point), mixed_.data(), normal);
    const EliminatedPoint e = eliminated(normal, damping);
    if (!sparse_) eliminated_[index] = e;
    const Eigen::Vector3d y = lower_of(e.L_inverse) * e.b;
    eliminate(free_.data(), point.end - point.begin, mixed_.data(), e.L_inverse.data(), y.data(),
              Z_.data(), system);
  }

  static EliminatedPoint eliminated(const PointNormal& normal, double damping) {
    EliminatedPoint e;
    Eigen::Matrix3d V = lower_of(normal.V);
    e.b = Eigen::Vector3d(normal.b);
    e.damping = damping * V.diagonal().cwiseMax(Damping::kMinDiagonal);
    V.diagonal() += e.damping;
    const Eigen::Matrix3d L = inverse_of_cholesky(V);
    e.L_inverse = {L(0, 0), L(1, 0), L(1, 1), L(2, 0), L(2, 1), L(2, 2)};
    return e;
  }

  /// A point as it was eliminated.
  [[nodiscard]] EliminatedPoint eliminated(std::size_t index, double damping) const {
    if (!sparse_) return eliminated_[index];
    const SchurPoint& point = points_[index];
    PointNormal normal;
    point_normal_of(groups_.data() + point.group, point.groups(), view_, view_of(point), normal);
    return eliminated(normal, damping);
  }

  /// The lower triangle is all that is read.
  template <typename Six>
  static Eigen::Matrix3d lower_of(const Six& n) {
    Eigen::Matrix3d lower;
    lower << n[0], 0, 0, n[1], n[2], 0, n[3], n[4], n[5];
    return lower;
  }

  /// Inverse of the lower Cholesky factor of a positive definite 3x3 matrix.
  static Eigen::Matrix3d inverse_of_cholesky(const Eigen::Matrix3d& V) {
    const double l00 = std::sqrt(V(0, 0));
    const double i00 = 1.0 / l00;
    const double l10 = V(1, 0) * i00;
    const double l20 = V(2, 0) * i00;
    const double i11 = 1.0 / std::sqrt(V(1, 1) - l10 * l10);
    const double l21 = (V(2, 1) - l20 * l10) * i11;
    const double i22 = 1.0 / std::sqrt(V(2, 2) - l20 * l20 - l21 * l21);
    Eigen::Matrix3d inverse;
    inverse << i00, 0, 0, -l10 * i00 * i11, i11, 0, (l10 * l21 * i11 - l20) * i00 * i22,
        -l21 * i11 * i22, i22;
    return inverse;
  }

  /// Solves for the increments of the poses.
  bool solve_reduced(double damping) {
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    if (poses == 0) return true;
    for (std::int32_t r = 0; r < poses; ++r) {
      // The point terms have been taken off already; the damping is that of the full diagonal.
      pose_damping_[r] = damping * sums_[r].diagonal().cwiseMax(Damping::kMinDiagonal);
      block(r, r).diagonal() += pose_damping_[r];
      flat_gradient_.segment<6>(6 * r) = -sums_[r].gradient();
    }
    if (!(sparse_ ? solve_sparse() : solve_dense())) return false;
    for (std::int32_t r = 0; r < poses; ++r) pose_step_[r] = flat_gradient_.segment<6>(6 * r);
    return flat_gradient_.allFinite();
  }

  bool solve_dense() {
    const auto poses = static_cast<std::int32_t>(free_pose_.size());
    for (std::int32_t r = 0; r < poses; ++r) {
      for (std::int32_t c = 0; c <= r; ++c) dense_.block<6, 6>(6 * r, 6 * c) = block(r, c);
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(dense_);
    if (factor.info() != Eigen::Success) return false;
    factor.solveInPlace(flat_gradient_);
    return true;
  }

  bool solve_sparse() {
    const BlockCholesky::Result result = sparse_->factorise(reduced_, options_.stop);
    stopped_ = result == BlockCholesky::Result::kStopped;
    if (result != BlockCholesky::Result::kDone) return false;
    sparse_->solve(flat_gradient_);
    return true;
  }

  /// Increments of the points, and the decrease predicted for the whole step:
  /// 1/2 (step^T damping step - step^T gradient), with the gradient before elimination.
  double back_substitute(double damping) {
    double predicted = 0;
    for (std::size_t r = 0; r < pose_step_.size(); ++r) {
      predicted += pose_step_[r].dot(pose_damping_[r].cwiseProduct(pose_step_[r]));
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data()) = pose_step_[r].head<3>();
      Eigen::Map<Eigen::Vector3d>(lane_steps_[r + 1].numbers.data() + 4) = pose_step_[r].tail<3>();
      predicted -=
          pose_step_[r].dot(sums_[r].gradient());  // reduced: the point part is added below
    }
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const EliminatedPoint e = eliminated(k, damping);
      const SchurPoint& point = points_[k];
      Eigen::Vector3d gradient;
      moved_gradient(groups_.data() + point.group, point.groups(), view_, view_of(point),
                     lane_steps_.data(), gradient.data());
      const Eigen::Matrix3d L_inverse = lower_of(e.L_inverse);
      const Eigen::Vector3d moved = L_inverse * gradient;  // sum of Z^T pose_step
      const Eigen::Vector3d y = L_inverse * e.b;
      const Eigen::Vector3d step = -(L_inverse.transpose() * (y + moved));
      other_points_[k] = problem_.points[point.point] + step;
      predicted += step.dot(e.damping.cwiseProduct(step));
      predicted -= step.dot(e.b) + moved.dot(y);
    }
    return 0.5 * predicted;
  }

  void apply() {
    old_poses_.clear();
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      Rigid3& T = problem_.T_c_w[free_pose_[r]];
      old_poses_.push_back(T);
      T = plus_left(T, pose_step_[r]);
    }
    swap_points();
    update_matrices();
  }

  void restore() {
    for (std::size_t r = 0; r < free_pose_.size(); ++r) {
      problem_.T_c_w[free_pose_[r]] = old_poses_[r];
    }
    swap_points();
    update_matrices();
  }

  void swap_points() {
    for (std::size_t k = 0; k < points_.size(); ++k) {
      std::swap(problem_.points[points_[k].point], other_points_[k]);
    }
  }

  template <typename T>
  using AlignedVector = std::vector<T, Eigen::aligned_allocator<T>>;

  BundleProblem& problem_;
  const BundleOptions& options_;
  View view_;
  bool stopped_ = false;                  // in the middle of a step
  std::vector<std::int32_t> free_index_;  // per pose: position among the free ones, or -1
  std::vector<std::int32_t> free_pose_;   // the other way
  std::vector<SchurPoint> points_;
  std::vector<ObservationLanes> groups_;  // of all points
  std::vector<std::int32_t> free_;        // of the point worked on
  std::vector<MixedLanes> mixed_;         // of the point worked on
  std::vector<PoseMatrix> matrices_;

  BlockPlaces places_;
  AlignedVector<Matrix6d> reduced_;  // blocks of the lower triangle, row by row
  std::vector<PoseSums> sums_;
  AlignedVector<Vector6d> pose_damping_;
  AlignedVector<Vector6d> pose_step_;
  std::vector<PoseStep> lane_steps_;  // the same for lanes; the first is for what is fixed
  std::optional<BlockCholesky> sparse_;
  Eigen::MatrixXd dense_;
  Eigen::VectorXd flat_gradient_;
  AlignedVector<Matrix63> Z_;                // of the point worked on
  std::vector<EliminatedPoint> eliminated_;  // of windows
  std::vector<Rigid3> old_poses_;
  std::vector<Eigen::Vector3d> other_points_;  // after a step not taken yet, or before it
};

}  // namespace

BundleRoundSummary solve_bundle_schur(BundleProblem& problem, const BundleOptions& options,
                                      const BundleRound& round) {
  return SchurBundle(problem, options, round).solve(round.iterations);
}

}  // namespace kys_slam
