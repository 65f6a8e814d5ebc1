// SPDX-License-Identifier: BSD-3-Clause
#include "fitted_rig.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/rotation.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace kys_slam {

namespace {

constexpr int kLens = 5;  // k1 k2 p1 p2 k3, or k1 k2 k3 k4 and nothing
constexpr int kColumns = 16, kRows = 9;
// Disparities of the grid's points over the width of the image.
constexpr std::array kDisparities = {1e-5, 0.01, 0.03, 0.08};

/// fx fy cx cy, and the coefficients of the lens.
struct Intrinsics {
  std::array<double, 4> K{};
  std::array<double, kLens> lens{};
};

/// Pixel of a point in the camera's frame, as OpenCV's pinhole and fisheye models.
template <typename T>
void project(LensModel model, const T* K, const T* d, const T* p, T* pixel) {
  using std::atan2;
  using std::sqrt;
  const T x = p[0] / p[2], y = p[1] / p[2];
  const T r2 = x * x + y * y;
  T u, v;
  if (model == LensModel::kEquidistant) {
    const T r = sqrt(r2 + T(1e-24));
    const T theta = atan2(r, T(1));
    const T t2 = theta * theta;
    const T bent = theta * (T(1) + t2 * (d[0] + t2 * (d[1] + t2 * (d[2] + t2 * d[3]))));
    u = x * bent / r;
    v = y * bent / r;
  } else {
    const T radial = T(1) + r2 * (d[0] + r2 * (d[1] + r2 * d[4]));
    u = x * radial + T(2) * d[2] * x * y + d[3] * (r2 + T(2) * x * x);
    v = y * radial + d[2] * (r2 + T(2) * y * y) + T(2) * d[3] * x * y;
  }
  pixel[0] = K[0] * u + K[2];
  pixel[1] = K[1] * v + K[3];
}

/// A point in the left camera's frame, and where a camera sees it.
struct Sight {
  LensModel model;
  Eigen::Vector3d point;
  Eigen::Vector2d pixel;

  template <typename T>
  bool operator()(const T* K, const T* lens, T* residual) const {
    const T p[3] = {T(point.x()), T(point.y()), T(point.z())};
    project(model, K, lens, p, residual);
    residual[0] -= T(pixel.x());
    residual[1] -= T(pixel.y());
    return true;
  }
  /// \param pose rotation vector and translation, left to right
  template <typename T>
  bool operator()(const T* K, const T* lens, const T* pose, T* residual) const {
    const T p[3] = {T(point.x()), T(point.y()), T(point.z())};
    T moved[3];
    ceres::AngleAxisRotatePoint(pose, p, moved);
    for (int k = 0; k < 3; ++k) moved[k] += pose[3 + k];
    project(model, K, lens, moved, residual);
    residual[0] -= T(pixel.x());
    residual[1] -= T(pixel.y());
    return true;
  }
};

Intrinsics intrinsics_of(const RawCamera& c) {
  Intrinsics result;
  result.K = {c.fx, c.fy, c.cx, c.cy};
  std::copy_n(c.distortion.begin(), std::min<std::size_t>(kLens, c.distortion.size()),
              result.lens.begin());
  return result;
}

/// The mapping from rectified pixels to those of the images as given.
class GivenCamera {
 public:
  GivenCamera(const RawCamera& raw, const StereoCamera& rectified,
              const Eigen::Matrix3d& R_raw_rectified, bool is_rectified)
      : raw_(raw), rectified_(rectified), R_(R_raw_rectified), same_(is_rectified) {}

  [[nodiscard]] Eigen::Vector2d pixel(const Eigen::Vector2d& p) const {
    if (same_) return p;
    const Eigen::Vector3d ray = R_ * Eigen::Vector3d((p.x() - rectified_.cx) / rectified_.fx,
                                                     (p.y() - rectified_.cy) / rectified_.fy, 1);
    const Intrinsics k = intrinsics_of(raw_);
    Eigen::Vector2d result;
    project(raw_.lens, k.K.data(), k.lens.data(), ray.data(), result.data());
    return result;
  }
  [[nodiscard]] bool sees(const Eigen::Vector2d& pixel) const {
    return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() <= raw_.width - 1 &&
           pixel.y() <= raw_.height - 1;
  }

 private:
  const RawCamera& raw_;
  const StereoCamera& rectified_;
  Eigen::Matrix3d R_;
  bool same_;
};

class Fit {
 public:
  Fit(const StereoRig& given, const StereoCamera& rectified, const RigCorrection& correction,
      int coefficients)
      : given_(given), left_(intrinsics_of(given.left)), right_(intrinsics_of(given.right)) {
    const bool is_rectified = given.rectified().has_value();
    Eigen::Matrix3d R_b_c = given.left.T_b_s.R();
    if (!is_rectified) {
      R_b_c = StereoRectifier(given.left, given.right, given.name).T_b_c().R();
    }
    const Eigen::Matrix3d R_l = given.left.T_b_s.R().transpose() * R_b_c;
    const Eigen::Matrix3d R_r = given.right.T_b_s.R().transpose() * R_b_c;
    look(rectified, correction, R_l, GivenCamera(given.left, rectified, R_l, is_rectified),
         GivenCamera(given.right, rectified, R_r, is_rectified));
    const Rigid3 T_r_l = given.right.T_b_s.inverse() * given.left.T_b_s;
    Eigen::Map<Eigen::Matrix<double, 6, 1>> pose(pose_.data());
    pose << so3_log(T_r_l.rotation), T_r_l.translation;
    solve(given.left.lens == LensModel::kEquidistant ? 4 : coefficients);
  }

  [[nodiscard]] FittedRig result() const {
    FittedRig fitted{given_, 0, 0};
    put(left_, fitted.rig.left);
    put(right_, fitted.rig.right);
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> pose(pose_.data());
    const Rigid3 T_r_l(so3_exp(pose.head<3>()), pose.tail<3>());
    fitted.rig.right.T_b_s = fitted.rig.left.T_b_s * T_r_l.inverse();
    std::size_t count = 0;
    const auto note = [&](const Eigen::Vector2d& residual) {
      fitted.largest = std::max(fitted.largest, residual.norm());
      fitted.rms += residual.squaredNorm();
      count += 2;
    };
    for (const Sight& s : in_left_) {
      Eigen::Vector2d residual;
      s(left_.K.data(), left_.lens.data(), residual.data());
      note(residual);
    }
    for (const Sight& s : in_right_) {
      Eigen::Vector2d residual;
      s(right_.K.data(), right_.lens.data(), pose_.data(), residual.data());
      note(residual);
    }
    fitted.rms = std::sqrt(fitted.rms / static_cast<double>(std::max<std::size_t>(1, count)));
    return fitted;
  }

 private:
  /// What the corrected pair sees of points on a grid.
  void look(const StereoCamera& camera, const RigCorrection& correction, const Eigen::Matrix3d& R_l,
            const GivenCamera& left, const GivenCamera& right) {
    for (int i = 0; i <= kColumns; ++i) {
      for (int j = 0; j <= kRows; ++j) {
        const double u = (camera.width - 1.0) * i / kColumns;
        const double v = (camera.height - 1.0) * j / kRows;
        const Eigen::Vector2d ideal = correction.left(u, v);
        const Eigen::Vector2d at = left.pixel({u, v});
        for (const double share : kDisparities) {
          const double disparity = share * camera.width;
          const Eigen::Vector3d p =
              R_l * camera.back_project(ideal.x(), ideal.y(), camera.bf() / disparity);
          if (left.sees(at)) in_left_.push_back({given_.left.lens, p, at});
          const Eigen::Vector2d there =
              right.pixel(correction.measured_right(ideal.x(), ideal.y(), ideal.x() - disparity));
          if (right.sees(there)) in_right_.push_back({given_.right.lens, p, there});
        }
      }
    }
  }

  void solve(int coefficients) {
    ceres::Problem problem;
    for (const Sight& s : in_left_) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Sight, 2, 4, kLens>(new Sight(s)),
                               nullptr, left_.K.data(), left_.lens.data());
    }
    for (const Sight& s : in_right_) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Sight, 2, 4, kLens, 6>(new Sight(s)),
                               nullptr, right_.K.data(), right_.lens.data(), pose_.data());
    }
    for (Intrinsics* k : {&left_, &right_}) {
      if (coefficients >= kLens || !problem.HasParameterBlock(k->lens.data())) continue;
      k->lens[kLens - 1] = 0;
      problem.SetManifold(k->lens.data(),
                          new ceres::SubsetManifold(kLens, std::vector<int>{kLens - 1}));
    }
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    options.num_threads = 1;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-12;
    options.parameter_tolerance = 1e-12;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    coefficients_ = coefficients;
  }

  void put(const Intrinsics& from, RawCamera& camera) const {
    camera.fx = from.K[0], camera.fy = from.K[1], camera.cx = from.K[2], camera.cy = from.K[3];
    camera.distortion.assign(from.lens.begin(), from.lens.begin() + coefficients_);
  }

  const StereoRig& given_;
  Intrinsics left_, right_;
  std::array<double, 6> pose_{};  // left to right
  std::vector<Sight> in_left_, in_right_;
  int coefficients_ = kLens;
};

}  // namespace

FittedRig fit_rig(const StereoRig& given, const StereoCamera& rectified,
                  const RigCorrection& correction, int coefficients) {
  return Fit(given, rectified, correction, coefficients).result();
}

}  // namespace kys_slam
