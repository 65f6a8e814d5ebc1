// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/rig_correction.h>

namespace kys_slam {

namespace {

constexpr int at(RigParameter p) {
  return static_cast<int>(p);
}

// Lens terms of a camera, in the order of their parameters.
constexpr int kLensTerms = 4;

/// Displacements by a unit of k1, k2, p1, p2.
Eigen::Matrix<double, 2, kLensTerms> lens_terms(const Eigen::Vector2d& m) {
  const double x = m.x(), y = m.y();
  const double r2 = x * x + y * y;
  Eigen::Matrix<double, 2, kLensTerms> terms;
  terms << -r2 * x, -r2 * r2 * x, -2 * x * y, -(r2 + 2 * x * x),  //
      -r2 * y, -r2 * r2 * y, -(r2 + 2 * y * y), -2 * x * y;
  return terms;
}

// Terms of the right camera's pose and focal length, from kYaw to kRatio.
constexpr int kPoseTerms = at(RigParameter::kRatio) - at(RigParameter::kYaw) + 1;

Eigen::Matrix<double, 2, kPoseTerms> pose_terms(const Eigen::Vector2d& m) {
  const double x = m.x(), y = m.y();
  Eigen::Matrix<double, 2, kPoseTerms> terms;
  terms << x * x, -x * y, -y, -x,  //
      x * y, -y * y, x, -y;
  return terms;
}

/// Solves m + displacement(m) = wanted: the displacement changes by a few per cent of a step.
template <typename Ray>
Eigen::Vector2d invert(const Eigen::Vector2d& wanted, const Ray& ray) {
  constexpr int kSteps = 5;
  Eigen::Vector2d m = wanted;
  for (int i = 0; i < kSteps; ++i) m += wanted - ray(m);
  return m;
}

}  // namespace

RigCorrection::RigCorrection(const StereoCamera& given, const Parameters& parameters)
    : given_(given), parameters_(parameters), scale_(1 + parameters[at(RigParameter::kFocal)]) {
  Parameters others = parameters;
  others[at(RigParameter::kOffset)] = 0;
  bends_ = (others.array() != 0).any();
}

RigCorrection RigCorrection::of_offset(const StereoCamera& given, double offset) {
  Parameters parameters = Parameters::Zero();
  parameters[at(RigParameter::kOffset)] = offset;
  return {given, parameters};
}

Eigen::Vector2d RigCorrection::normalised(double u, double v) const {
  return {(u - given_.cx) / (given_.fx * scale_), (v - given_.cy) / (given_.fy * scale_)};
}

Eigen::Vector2d RigCorrection::pixel(const Eigen::Vector2d& ray, double scale) const {
  return {given_.fx * scale * ray.x() + given_.cx, given_.fy * scale * ray.y() + given_.cy};
}

Eigen::Vector2d RigCorrection::left_ray(const Eigen::Vector2d& m) const {
  return m + lens_terms(m) * parameters_.segment<kLensTerms>(at(RigParameter::kLeftK1));
}

Eigen::Vector2d RigCorrection::right_ray(const Eigen::Vector2d& m) const {
  const Eigen::Vector2d moved =
      lens_terms(m) * parameters_.segment<kLensTerms>(at(RigParameter::kRightK1)) +
      pose_terms(m) * parameters_.segment<kPoseTerms>(at(RigParameter::kYaw));
  return m + moved - Eigen::Vector2d(offset() / given_.fx, (*this)[RigParameter::kRow] / given_.fy);
}

double RigCorrection::inverse_depth(double x_left, double x_right) const {
  return (x_left - x_right) / (1 - x_right * (*this)[RigParameter::kBaselineZ]);
}

Eigen::Vector2d RigCorrection::left(double u, double v) const {
  if (!bends_) return {u, v};
  return pixel(left_ray(normalised(u, v)), 1);
}

Eigen::Vector2d RigCorrection::right(double u, double v) const {
  if (!bends_) return {u - offset(), v};
  return pixel(right_ray(normalised(u, v)), 1);
}

RigCorrection::Ideal RigCorrection::pair(const Measured& m) const {
  Ideal ideal{m.u, m.v, m.u_right - offset(), std::isnan(m.v_right) ? 0 : m.v_right - m.v};
  if (!bends_) return ideal;
  const Eigen::Vector2d l = left_ray(normalised(m.u, m.v));
  ideal.u = given_.fx * l.x() + given_.cx;
  ideal.v = given_.fy * l.y() + given_.cy;
  double v_right = m.v_right;
  if (std::isnan(v_right)) {
    const double disparity = scale_ * static_cast<double>(m.u - m.u_right);
    v_right = measured_right(ideal.u, ideal.v, ideal.u - disparity).y();
  }
  const Eigen::Vector2d r = right_ray(normalised(m.u_right, v_right));
  const double q = inverse_depth(l.x(), r.x());
  ideal.u_right = ideal.u - given_.fx * scale_ * q;
  if (std::isnan(m.v_right)) return ideal;
  const double expected =
      (l.y() - (*this)[RigParameter::kBaselineY] * q) / (1 - (*this)[RigParameter::kBaselineZ] * q);
  ideal.row = given_.fy * (r.y() - expected);
  return ideal;
}

Eigen::Vector2d RigCorrection::measured_left(double u, double v) const {
  if (!bends_) return {u, v};
  const Eigen::Vector2d m = invert({(u - given_.cx) / given_.fx, (v - given_.cy) / given_.fy},
                                   [&](const Eigen::Vector2d& at_m) { return left_ray(at_m); });
  return pixel(m, scale_);
}

Eigen::Vector2d RigCorrection::measured_right(double u, double v, double u_right) const {
  if (!bends_) return {u_right + offset(), v};
  const double q = (u - u_right) / (given_.fx * scale_);
  const double nearer = 1 - (*this)[RigParameter::kBaselineZ] * q;
  const Eigen::Vector2d ray(
      ((u - given_.cx) / given_.fx - q) / nearer,
      ((v - given_.cy) / given_.fy - (*this)[RigParameter::kBaselineY] * q) / nearer);
  const Eigen::Vector2d m =
      invert(ray, [&](const Eigen::Vector2d& at_m) { return right_ray(at_m); });
  return pixel(m, scale_);
}

Eigen::Vector2d RigCorrection::stretch(double u, double v) const {
  if (!bends_) return {1, 1};
  constexpr double kStep = 0.5;  // px; the polynomial is of low order
  const double along = left(u + kStep, v).x() - left(u - kStep, v).x();
  const double across = left(u, v + kStep).y() - left(u, v - kStep).y();
  return {along / (2 * kStep), across / (2 * kStep)};
}

RigCorrection::Jacobian RigCorrection::jacobian(const Measured& m) const {
  const Eigen::Vector2d l = normalised(m.u, m.v);
  const double v_right = std::isnan(m.v_right) ? m.v : m.v_right;
  const Eigen::Vector2d r = normalised(m.u_right, v_right);
  const double q = l.x() - r.x();
  const Eigen::Vector2d f(given_.fx, given_.fy);
  constexpr int kLeft = at(RigParameter::kLeftK1), kRight = at(RigParameter::kRightK1);
  constexpr int kPose = at(RigParameter::kYaw);
  Jacobian J = Jacobian::Zero();
  J.block<2, kLensTerms>(0, kLeft) = f.asDiagonal() * lens_terms(l);
  J.block<2, kLensTerms>(2, kLeft) = J.block<2, kLensTerms>(0, kLeft);
  J.block<2, kLensTerms>(2, kRight) = -(f.asDiagonal() * lens_terms(r));
  J.block<2, kPoseTerms>(2, kPose) = -(f.asDiagonal() * pose_terms(r));
  J(2, at(RigParameter::kOffset)) = 1;
  J(3, at(RigParameter::kRow)) = 1;  // as a left row less a right row, below
  J(2, at(RigParameter::kBaselineZ)) = f.x() * q * r.x();
  J(3, at(RigParameter::kBaselineY)) = -f.y() * q;
  J(3, at(RigParameter::kBaselineZ)) = f.y() * q * l.y();
  J.row(3) = -J.row(3);
  J.block<2, 1>(0, at(RigParameter::kFocal)) = -f.cwiseProduct(l);
  return J;
}

const std::array<RigParameterName, RigCorrection::kSize>& rig_parameter_names() {
  static constexpr std::array<RigParameterName, RigCorrection::kSize> kNames{{
      {"left_k1", ""},
      {"left_k2", ""},
      {"left_p1", ""},
      {"left_p2", ""},
      {"right_k1", ""},
      {"right_k2", ""},
      {"right_p1", ""},
      {"right_p2", ""},
      {"yaw", "rad"},
      {"pitch", "rad"},
      {"roll", "rad"},
      {"focal_ratio", ""},
      {"offset", "px"},
      {"row", "px"},
      {"baseline_y", ""},
      {"baseline_z", ""},
      {"focal", ""},
  }};
  return kNames;
}

Eigen::Vector4d RigEstimate::sigma(const RigCorrection::Measured& m) const {
  const RigCorrection::Jacobian J = correction.jacobian(m);
  return (J * covariance * J.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
}

}  // namespace kys_slam
