// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/ego_motion.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "util/lanes.h"

namespace kys_slam {
namespace {

/// px; steps that change the predicted flow by less are not worth another.
constexpr double kConverged = 1e-4;

/// Pixels of the fit, kLanes at a time.
struct SampleLanes {
  Lanes u{}, v{};            // px
  Lanes inverse_z{};         // 1/m
  Lanes flow_u{}, flow_v{};  // px, observed
  Lanes present{};           // 1; 0 in lanes past the end
};

struct Samples {
  std::vector<SampleLanes> lanes;
  int count = 0;

  void add(int x, int y, float inverse_z, float flow_u, float flow_v) {
    const int lane = count++ % kLanes;
    if (lane == 0) lanes.emplace_back();
    SampleLanes& to = lanes.back();
    to.u[lane] = x;
    to.v[lane] = y;
    to.inverse_z[lane] = inverse_z;
    to.flow_u[lane] = flow_u;
    to.flow_v[lane] = flow_v;
    to.present[lane] = 1;
  }
};

/// The usable pixels of a grid of which every step-th column and row is looked at.
Samples take_samples(int step, int border, const FlowField& flow, const ImageOf<float>& disparity,
                     const InverseDepth& inverse_depth, const ImageOf<std::uint16_t>& segment_map,
                     const std::vector<std::uint8_t>& is_stuff) {
  const int width = segment_map.width(), height = segment_map.height();
  const double pixels = static_cast<double>(width) * height;
  Samples samples;
  samples.lanes.reserve(static_cast<std::size_t>(pixels / (step * step)) / kLanes + 1);
  for (int y = border; y < height - border; y += step) {
    // Each row of the grid starts elsewhere, so that vertical structures are not missed.
    const int first = border + (y / step * 5) % step;
    for (int x = first; x < width - border; x += step) {
      const float rho = inverse_depth(disparity.at(x, y)), u = flow.u.at(x, y), v = flow.v.at(x, y);
      if (!is_stuff[segment_map.at(x, y)] || !(rho > 0) || !std::isfinite(u) || !std::isfinite(v)) {
        continue;
      }
      samples.add(x, y, rho, u, v);
    }
  }
  return samples;
}

int grid_step(const BuilderOptions::EgoMotion& options, int width, int height) {
  if (options.grid_samples <= 0) return 1;
  const double pixels = static_cast<double>(width) * height;
  return std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / options.grid_samples))));
}

/// Residuals (px) of a model of N unknowns and the derivatives of the prediction.
template <int N>
struct Linearized {
  Lanes ru, rv;
  Lanes ju[N], jv[N];
  Lanes present;  ///< 1, or 0 for samples without a prediction
};

/// The exact model, and its derivatives by [w; t] of plus().
class Se3Model {
 public:
  static constexpr int kUnknowns = 6;

  Se3Model(const StereoCamera& camera, const Rigid3& T)
      : fx_(camera.fx), fy_(camera.fy), cx_(camera.cx), cy_(camera.cy) {
    const Eigen::Matrix3d R = T.R();
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) R_[i][j] = R(i, j);
      t_[i] = T.t()(i);
    }
  }

  KYS_ALWAYS_INLINE void linearize(const SampleLanes& s, Linearized<6>& out) const {
    // Everything divided by Z, as flow does not change when scene and translation are scaled.
    const Lanes x = (s.u - cx_) / fx_, y = (s.v - cy_) / fy_;
    const Lanes a = R_[0][0] * x + R_[0][1] * y + R_[0][2];
    const Lanes b = R_[1][0] * x + R_[1][1] * y + R_[1][2];
    const Lanes c = R_[2][0] * x + R_[2][1] * y + R_[2][2];
    const Lanes depth = c + s.inverse_z * t_[2];
    const LaneMask in_front = depth > broadcast(1e-3);
    out.present = in_front ? s.present : broadcast(0.0);
    const Lanes inverse = 1.0 / (in_front ? depth : broadcast(1.0));
    const Lanes next_x = (a + s.inverse_z * t_[0]) * inverse;
    const Lanes next_y = (b + s.inverse_z * t_[1]) * inverse;
    out.ru = s.flow_u - fx_ * (next_x - x);
    out.rv = s.flow_v - fy_ * (next_y - y);
    // Derivatives of the two by the point: (u0, 0, u2) and (0, v1, v2). The point changes by
    // w x (a, b, c) + inverse_z dt.
    const Lanes u0 = fx_ * inverse, u2 = -u0 * next_x;
    const Lanes v1 = fy_ * inverse, v2 = -v1 * next_y;
    out.ju[0] = b * u2;
    out.ju[1] = c * u0 - a * u2;
    out.ju[2] = -b * u0;
    out.ju[3] = s.inverse_z * u0;
    out.ju[4] = Lanes{};
    out.ju[5] = s.inverse_z * u2;
    out.jv[0] = b * v2 - c * v1;
    out.jv[1] = -a * v2;
    out.jv[2] = a * v1;
    out.jv[3] = Lanes{};
    out.jv[4] = s.inverse_z * v1;
    out.jv[5] = s.inverse_z * v2;
  }

 private:
  double fx_, fy_, cx_, cy_;
  double R_[3][3], t_[3];
};

/// What the two models of eight parameters differ in.
struct LinearFactors {
  double roll_u, roll_v, pitch_u;
};

LinearFactors linear_factors(const EgoMotion& motion) {
  if (motion.model == EgoMotionModel::kAsPrinted) return {-1, -1, -1};
  const double aspect = static_cast<double>(motion.camera.width) / motion.camera.height;
  return {-1 / aspect, aspect, 1};
}

/// The two rows of Eq. 6 in px: flow = row . c.
class LinearModel {
 public:
  static constexpr int kUnknowns = 8;

  explicit LinearModel(const EgoMotion& motion)
      : c_(motion.c),
        factors_(linear_factors(motion)),
        width_(motion.camera.width),
        height_(motion.camera.height) {}

  KYS_ALWAYS_INLINE void linearize(const SampleLanes& s, Linearized<8>& out) const {
    const Lanes x = s.u / width_ - 0.5, y = s.v / height_ - 0.5;
    const Lanes w = broadcast(width_), h = broadcast(height_);
    out.ju[0] = w;
    out.ju[1] = w * s.inverse_z;
    out.ju[2] = -w * x * s.inverse_z;
    out.ju[3] = w * factors_.roll_u * y;
    out.ju[4] = w * x * x;
    out.ju[5] = w * factors_.pitch_u * x * y;
    out.ju[6] = out.ju[7] = Lanes{};
    out.jv[0] = out.jv[1] = Lanes{};
    out.jv[2] = -h * y * s.inverse_z;
    out.jv[3] = h * factors_.roll_v * x;
    out.jv[4] = h * x * y;
    out.jv[5] = h * y * y;
    out.jv[6] = h;
    out.jv[7] = h * s.inverse_z;
    out.ru = s.flow_u;
    out.rv = s.flow_v;
    for (int i = 0; i < 8; ++i) {
      out.ru -= c_[static_cast<std::size_t>(i)] * out.ju[i];
      out.rv -= c_[static_cast<std::size_t>(i)] * out.jv[i];
    }
    out.present = s.present;
  }

 private:
  std::array<double, 8> c_;
  LinearFactors factors_;
  double width_, height_;
};

/// Normal equations of N unknowns: the upper triangle, row by row, and the right side.
template <int N>
struct NormalSums {
  Lanes A[N * (N + 1) / 2] = {};
  Lanes b[N] = {};
  Lanes weight = {};
};

KYS_ALWAYS_INLINE Lanes length(const Lanes& u, const Lanes& v) {
  return sqrt_lanes(u * u + v * v);
}

template <typename Model, int N>
KYS_ALWAYS_INLINE void accumulate(const Model& model, const Samples& samples, std::size_t stride,
                                  double delta, NormalSums<N>& sums) {
  Linearized<N> e;
  for (std::size_t k = 0; k < samples.lanes.size(); k += stride) {
    model.linearize(samples.lanes[k], e);
    // Huber's weight.
    const Lanes norm = length(e.ru, e.rv);
    const Lanes w = e.present * (norm > broadcast(delta) ? delta / norm : broadcast(1.0));
    sums.weight += w;
    int at = 0;
    for (int i = 0; i < N; ++i) {
      const Lanes wu = w * e.ju[i], wv = w * e.jv[i];
      for (int j = i; j < N; ++j) sums.A[at++] += wu * e.ju[j] + wv * e.jv[j];
      sums.b[i] += wu * e.ru + wv * e.rv;
    }
  }
}

template <typename Model>
KYS_ALWAYS_INLINE double total_residual(const Model& model, const Samples& samples) {
  Lanes sum = {};
  Linearized<Model::kUnknowns> e;
  for (const SampleLanes& s : samples.lanes) {
    model.linearize(s, e);
    sum += e.present * length(e.ru, e.rv);
  }
  return lane_sum(sum);
}

// What templates instantiate cannot be cloned; what these inline is.
KYS_VECTOR_CLONES void sum_up(const Se3Model& model, const Samples& samples, std::size_t stride,
                              double delta, NormalSums<6>& sums) {
  accumulate(model, samples, stride, delta, sums);
}
KYS_VECTOR_CLONES void sum_up(const LinearModel& model, const Samples& samples, std::size_t stride,
                              double delta, NormalSums<8>& sums) {
  accumulate(model, samples, stride, delta, sums);
}

/// Solves the least squares problem and applies the solution. \return how much it changes the
/// prediction, px, root of the weighted mean square; nothing when the equations are singular.
template <int N, typename Apply>
std::optional<double> solve(const NormalSums<N>& sums, const Apply& apply) {
  using Vector = Eigen::Matrix<double, N, 1>;
  Eigen::Matrix<double, N, N> A;
  Vector b;
  int at = 0;
  for (int i = 0; i < N; ++i) {
    for (int j = i; j < N; ++j) A(i, j) = A(j, i) = lane_sum(sums.A[at++]);
    b(i) = lane_sum(sums.b[i]);
  }
  // Unknowns of very different size (rad, m, 1/m): scale the diagonal to one first.
  const Vector scale = (A.diagonal().array() + 1e-30).rsqrt();
  Eigen::Matrix<double, N, N> M = scale.asDiagonal() * A * scale.asDiagonal();
  M.diagonal().array() += 1e-12;
  const Vector x = scale.cwiseProduct(M.ldlt().solve(scale.cwiseProduct(b)));
  if (!x.allFinite()) return std::nullopt;
  apply(x);
  return std::sqrt(std::max(0.0, x.dot(b)) / std::max(1.0, lane_sum(sums.weight)));
}

/// One re-weighted step over every stride-th group of samples: by how much it changed the predicted
/// flow (px, root mean square); nothing when it cannot be made.
std::optional<double> step(const Samples& samples, std::size_t stride, double delta,
                           EgoMotion& motion) {
  const auto solve_with = [&](const auto& model, auto sums, const auto& apply) {
    sum_up(model, samples, stride, delta, sums);
    return solve(sums, apply);
  };
  if (motion.model == EgoMotionModel::kSe3) {
    return solve_with(Se3Model(motion.camera, motion.T_next_now), NormalSums<6>(),
                      [&](const auto& x) { motion.T_next_now = plus(motion.T_next_now, x); });
  }
  return solve_with(LinearModel(motion), NormalSums<8>(), [&](const auto& x) {
    Eigen::Map<Eigen::Matrix<double, 8, 1>>(motion.c.data()) += x;
  });
}

bool fit(const BuilderOptions::EgoMotion& options, const Samples& samples, EgoMotion& motion) {
  if (motion.model == EgoMotionModel::kSe3) {
    // The linearisation point first, on a few samples and with a wide kernel.
    const std::size_t stride = std::max<std::size_t>(1, samples.lanes.size() / 200);
    double delta = 20 * options.huber_delta;
    for (int i = 0; i < 5; ++i, delta = std::max(options.huber_delta, delta / 3)) {
      if (!step(samples, stride, delta, motion)) return false;
    }
  } else if (!step(samples, 1, std::numeric_limits<double>::infinity(), motion)) {
    return false;  // the first solution is unweighted
  }
  for (int i = 0; i < options.iterations; ++i) {
    const std::optional<double> change = step(samples, 1, options.huber_delta, motion);
    if (!change) return false;
    if (*change < kConverged) break;
  }
  return motion.T_next_now.is_finite();
}

double mean_residual(const EgoMotion& motion, const Samples& samples) {
  const double sum = motion.model == EgoMotionModel::kSe3
                         ? total_residual(Se3Model(motion.camera, motion.T_next_now), samples)
                         : total_residual(LinearModel(motion), samples);
  return samples.count == 0 ? 0 : sum / samples.count;
}

Se3FlowRow se3_row(const EgoMotion& m, int y) {
  const StereoCamera& k = m.camera;
  const Eigen::Matrix3d R = m.T_next_now.R();
  const Eigen::Vector3d t = m.T_next_now.t();
  // The point at unit depth is step x + base + rho t.
  const Eigen::Vector3d step = R.col(0) / k.fx;
  const Eigen::Vector3d base = R.col(1) * ((y - k.cy) / k.fy) + R.col(2) - R.col(0) * (k.cx / k.fx);
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(k.fx * step.x()), f(k.fx * base.x()),
          f(k.fx * t.x()),    f(k.fy * step.y()),
          f(k.fy * base.y()), f(k.fy * t.y()),
          f(step.z()),        f(base.z()),
          f(t.z()),           f(k.cx),
          f(k.cy - y)};
}

LinearFlowRow linear_row(const EgoMotion& m, int y) {
  const double w = m.camera.width, h = m.camera.height;
  const double yn = (y - 0.5 * h) / h;
  const LinearFactors k = linear_factors(m);
  const auto& c = m.c;
  const auto f = [](double value) { return static_cast<float>(value); };
  return {f(1.0 / w),
          f(w * (c[0] + c[3] * k.roll_u * yn)),
          f(w * c[5] * k.pitch_u * yn),
          f(w * c[4]),
          f(w * c[1]),
          f(-w * c[2]),
          f(h * (c[6] + c[5] * yn * yn)),
          f(h * (c[3] * k.roll_v + c[4] * yn)),
          f(h * (c[7] - c[2] * yn))};
}

}  // namespace

FlowRow EgoMotion::flow_row(int y) const {
  if (model == EgoMotionModel::kSe3) return se3_row(*this, y);
  return linear_row(*this, y);
}

void EgoMotion::predict_row(int y, const float* inverse_depth, float* u, float* v) const {
  std::visit(
      [&](const auto& flow) {
        for (int x = 0; x < camera.width; ++x) {
          flow.at(static_cast<float>(x), inverse_depth[x], u[x], v[x]);
        }
      },
      flow_row(y));
}

std::optional<EgoMotion> fit_ego_motion(const BuilderOptions::EgoMotion& options,
                                        const StereoCamera& camera, const FlowField& flow,
                                        const ImageOf<float>& disparity,
                                        const InverseDepth& inverse_depth,
                                        const ImageOf<std::uint16_t>& segment_map,
                                        const std::vector<std::uint8_t>& is_stuff) {
  // Where things fill the image a finer grid finds what is left of the scene.
  int step = grid_step(options, segment_map.width(), segment_map.height());
  const auto sampled = [&] {
    return take_samples(step, options.border, flow, disparity, inverse_depth, segment_map,
                        is_stuff);
  };
  Samples samples = sampled();
  while (samples.count < options.min_samples && step > 1) {
    step /= 2;
    samples = sampled();
  }
  if (samples.count < options.min_samples) return std::nullopt;
  EgoMotion motion;
  motion.model = options.model;
  motion.camera = camera;
  motion.samples = samples.count;
  if (!fit(options, samples, motion)) return std::nullopt;
  motion.mean_residual = mean_residual(motion, samples);
  return motion;
}

}  // namespace kys_slam
