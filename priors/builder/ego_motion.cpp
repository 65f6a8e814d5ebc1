#include "priors/builder/ego_motion.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "priors/builder/vectorize.h"

namespace kys_slam {
namespace {

/// A pixel of the fit: its place, inverse depth and observed flow.
struct Sample {
  double u, v;            // px
  double inverse_z;       // 1/m
  double flow_u, flow_v;  // px
};

std::vector<Sample> take_samples(const BuilderOptions::EgoMotion& options, const FlowField& flow,
                                 const ImageOf<float>& inverse_depth,
                                 const ImageOf<std::uint16_t>& segment_map,
                                 const std::vector<std::uint8_t>& is_stuff) {
  const int width = segment_map.width(), height = segment_map.height();
  int step = 1;
  if (options.grid_samples > 0) {
    const double pixels = static_cast<double>(width) * height;
    step = std::max(1, static_cast<int>(std::lround(std::sqrt(pixels / options.grid_samples))));
  }
  std::vector<Sample> samples;
  for (int y = options.border; y < height - options.border; y += step) {
    // Each row of the grid starts elsewhere, so that vertical structures are not missed.
    const int first = options.border + (y / step * 5) % step;
    for (int x = first; x < width - options.border; x += step) {
      const float rho = inverse_depth.at(x, y), u = flow.u.at(x, y), v = flow.v.at(x, y);
      if (!is_stuff[segment_map.at(x, y)] || !(rho > 0) || !std::isfinite(u) || !std::isfinite(v)) {
        continue;
      }
      samples.push_back({static_cast<double>(x), static_cast<double>(y), rho, u, v});
    }
  }
  return samples;
}

double length(double a, double b) {
  return std::sqrt(a * a + b * b);
}

/// Huber weight of a residual of this length.
double weight(double length, double delta) {
  return length <= delta ? 1.0 : delta / length;
}

/// Normal equations of N unknowns with two residuals per sample.
template <int N>
class NormalEquations {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  void add(const Vector& ju, const Vector& jv, double ru, double rv, double w) {
    const Vector wu = w * ju, wv = w * jv;
    for (int column = 0; column < N; ++column) {
      for (int row = 0; row <= column; ++row) {
        A_(row, column) += wu(row) * ju(column) + wv(row) * jv(column);
      }
    }
    b_ += ru * wu + rv * wv;
  }
  /// Solution of the least squares problem; nothing when the equations are singular.
  [[nodiscard]] std::optional<Vector> solve() const {
    // Unknowns of very different size (rad, m, 1/m): scale the diagonal to one first.
    const Vector scale = (A_.diagonal().array() + 1e-30).rsqrt();
    Eigen::Matrix<double, N, N> M = A_.template selfadjointView<Eigen::Upper>();
    M = (scale.asDiagonal() * M * scale.asDiagonal()).eval();
    M.diagonal().array() += 1e-12;
    const Vector x = scale.cwiseProduct(M.ldlt().solve(scale.cwiseProduct(b_)));
    if (!x.allFinite()) return std::nullopt;
    return x;
  }

 private:
  Eigen::Matrix<double, N, N> A_ = Eigen::Matrix<double, N, N>::Zero();
  Vector b_ = Vector::Zero();
};

/// Residual of the exact model and its derivatives by [w; t] of plus(), px.
struct Se3Residual {
  double ru, rv;
  Eigen::Matrix<double, 6, 1> ju, jv;
};

bool evaluate_se3(const StereoCamera& k, const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                  const Sample& s, Se3Residual& out) {
  // Everything divided by Z, as flow does not change when scene and translation are scaled.
  const Eigen::Vector3d ray((s.u - k.cx) / k.fx, (s.v - k.cy) / k.fy, 1.0);
  const Eigen::Vector3d turned = R * ray;
  const Eigen::Vector3d q = turned + s.inverse_z * t;
  if (q.z() < 1e-3) return false;
  const double iz = 1.0 / q.z(), x = q.x() * iz, y = q.y() * iz;
  out.ru = s.flow_u - (k.fx * x + k.cx - s.u);
  out.rv = s.flow_v - (k.fy * y + k.cy - s.v);
  // d(u,v)/dq, and dq = w x turned + inverse_z dt.
  const Eigen::Vector3d du(k.fx * iz, 0, -k.fx * x * iz), dv(0, k.fy * iz, -k.fy * y * iz);
  out.ju << turned.cross(du), s.inverse_z * du;
  out.jv << turned.cross(dv), s.inverse_z * dv;
  return true;
}

/// One Gauss-Newton step over every stride-th sample. False when it cannot be made.
bool step_se3(const StereoCamera& camera, const std::vector<Sample>& samples, std::size_t stride,
              double delta, Rigid3& T) {
  NormalEquations<6> equations;
  const Eigen::Matrix3d R = T.R();
  Se3Residual e;
  for (std::size_t i = 0; i < samples.size(); i += stride) {
    if (!evaluate_se3(camera, R, T.t(), samples[i], e)) continue;
    equations.add(e.ju, e.jv, e.ru, e.rv, weight(length(e.ru, e.rv), delta));
  }
  const auto x = equations.solve();
  if (!x) return false;
  T = plus(T, *x);
  return true;
}

bool fit_se3(const BuilderOptions::EgoMotion& options, const std::vector<Sample>& samples,
             EgoMotion& motion) {
  // The linearisation point first, on a few samples and with a wide kernel; then the five steps.
  const std::size_t stride = std::max<std::size_t>(1, samples.size() / 800);
  double delta = 20 * options.huber_delta;
  for (int i = 0; i < 5; ++i, delta = std::max(options.huber_delta, delta / 3)) {
    if (!step_se3(motion.camera, samples, stride, delta, motion.T_next_now)) return false;
  }
  for (int i = 0; i < options.iterations; ++i) {
    if (!step_se3(motion.camera, samples, 1, options.huber_delta, motion.T_next_now)) return false;
  }
  return motion.T_next_now.is_finite();
}

using Row8 = Eigen::Matrix<double, 8, 1>;

/// The two rows of Eq. 6 in px: flow = row . c.
struct LinearRows {
  Row8 u, v;
};

LinearRows linear_rows(EgoMotionModel model, double width, double height, double px, double py,
                       double rho) {
  const double x = (px - 0.5 * width) / width, y = (py - 0.5 * height) / height;
  const bool printed = model == EgoMotionModel::kAsPrinted;
  const double roll_u = printed ? -y : -(height / width) * y;
  const double roll_v = printed ? -x : (width / height) * x;
  const double pitch_u = printed ? -x * y : x * y;
  LinearRows rows;
  rows.u << 1, rho, -x * rho, roll_u, x * x, pitch_u, 0, 0;
  rows.v << 0, 0, -y * rho, roll_v, x * y, y * y, 1, rho;
  rows.u *= width;
  rows.v *= height;
  return rows;
}

bool fit_linear(const BuilderOptions::EgoMotion& options, const std::vector<Sample>& samples,
                EgoMotion& motion) {
  Row8 c = Row8::Zero();
  for (int i = 0; i <= options.iterations; ++i) {  // the first solution is unweighted
    NormalEquations<8> equations;
    for (const Sample& s : samples) {
      const LinearRows rows = linear_rows(motion.model, motion.camera.width, motion.camera.height,
                                          s.u, s.v, s.inverse_z);
      const double norm = length(s.flow_u - rows.u.dot(c), s.flow_v - rows.v.dot(c));
      equations.add(rows.u, rows.v, s.flow_u, s.flow_v,
                    i == 0 ? 1.0 : weight(norm, options.huber_delta));
    }
    const auto x = equations.solve();
    if (!x) return false;
    c = *x;
  }
  Eigen::Map<Row8>(motion.c.data()) = c;
  return true;
}

KYS_ROW_LOOP void predict_row_se3(const EgoMotion& m, int y, const float* __restrict rho,
                                  float* __restrict u, float* __restrict v) {
  const StereoCamera& k = m.camera;
  const Eigen::Matrix3d R = m.T_next_now.R();
  const double yn = (y - k.cy) / k.fy;
  // q = step * x + base + rho * t; the first two in units of the ray at depth 1.
  const Eigen::Vector3d step = R.col(0) / k.fx;
  const Eigen::Vector3d base = R.col(1) * yn + R.col(2) - R.col(0) * (k.cx / k.fx);
  const float sx = static_cast<float>(step.x()), sy = static_cast<float>(step.y()),
              sz = static_cast<float>(step.z());
  const float bx = static_cast<float>(base.x()), by = static_cast<float>(base.y()),
              bz = static_cast<float>(base.z());
  const Eigen::Vector3f t = m.T_next_now.t().cast<float>();
  const float tx = t.x(), ty = t.y(), tz = t.z();
  const float fx = static_cast<float>(k.fx), fy = static_cast<float>(k.fy),
              cx = static_cast<float>(k.cx), cy = static_cast<float>(k.cy - y);
  for (int x = 0; x < k.width; ++x) {
    const auto px = static_cast<float>(x);
    const float iz = 1.0F / (sz * px + bz + tz * rho[x]);
    u[x] = fx * ((sx * px + bx + tx * rho[x]) * iz) + (cx - px);
    v[x] = fy * ((sy * px + by + ty * rho[x]) * iz) + cy;
  }
}

KYS_ROW_LOOP void predict_row_linear(const EgoMotion& m, int y, const float* __restrict rho,
                                     float* __restrict u, float* __restrict v) {
  // Each component is a + b x + d x^2 + rho (e + g x) along a row, x in pixels.
  const double w = m.camera.width, h = m.camera.height;
  const double yn = (y - 0.5 * h) / h;
  const bool printed = m.model == EgoMotionModel::kAsPrinted;
  const auto& c = m.c;
  const double ru = printed ? -yn : -(h / w) * yn, rv = printed ? -1.0 : w / h;
  const double pu = printed ? -yn : yn;
  const float u0 = static_cast<float>(w * (c[0] + c[3] * ru)),
              u1 = static_cast<float>(w * c[5] * pu), u2 = static_cast<float>(w * c[4]),
              ur = static_cast<float>(w * c[1]), urx = static_cast<float>(-w * c[2]);
  const float v0 = static_cast<float>(h * (c[6] + c[5] * yn * yn)),
              v1 = static_cast<float>(h * (c[3] * rv + c[4] * yn)),
              vr = static_cast<float>(h * (c[7] - c[2] * yn));
  const auto inverse_w = static_cast<float>(1.0 / w);
  for (int i = 0; i < m.camera.width; ++i) {
    const float x = static_cast<float>(i) * inverse_w - 0.5F;
    u[i] = u0 + x * (u1 + u2 * x) + rho[i] * (ur + urx * x);
    v[i] = v0 + x * v1 + rho[i] * vr;
  }
}

double mean_residual(const EgoMotion& motion, const std::vector<Sample>& samples) {
  double sum = 0;
  const Eigen::Matrix3d R = motion.T_next_now.R();
  const Eigen::Map<const Row8> c(motion.c.data());
  for (const Sample& s : samples) {
    if (motion.model == EgoMotionModel::kSe3) {
      Se3Residual e;
      if (evaluate_se3(motion.camera, R, motion.T_next_now.t(), s, e)) sum += length(e.ru, e.rv);
    } else {
      const LinearRows rows = linear_rows(motion.model, motion.camera.width, motion.camera.height,
                                          s.u, s.v, s.inverse_z);
      sum += length(s.flow_u - rows.u.dot(c), s.flow_v - rows.v.dot(c));
    }
  }
  return samples.empty() ? 0 : sum / static_cast<double>(samples.size());
}

}  // namespace

void EgoMotion::predict_row(int y, const float* inverse_depth, float* u, float* v) const {
  if (model == EgoMotionModel::kSe3) {
    predict_row_se3(*this, y, inverse_depth, u, v);
  } else {
    predict_row_linear(*this, y, inverse_depth, u, v);
  }
}

std::optional<EgoMotion> fit_ego_motion(const BuilderOptions::EgoMotion& options,
                                        const StereoCamera& camera, const FlowField& flow,
                                        const ImageOf<float>& inverse_depth,
                                        const ImageOf<std::uint16_t>& segment_map,
                                        const std::vector<std::uint8_t>& is_stuff) {
  const std::vector<Sample> samples =
      take_samples(options, flow, inverse_depth, segment_map, is_stuff);
  if (static_cast<int>(samples.size()) < options.min_samples) return std::nullopt;
  EgoMotion motion;
  motion.model = options.model;
  motion.camera = camera;
  motion.samples = static_cast<int>(samples.size());
  const bool fitted = options.model == EgoMotionModel::kSe3 ? fit_se3(options, samples, motion)
                                                            : fit_linear(options, samples, motion);
  if (!fitted) return std::nullopt;
  motion.mean_residual = mean_residual(motion, samples);
  return motion;
}

}  // namespace kys_slam
