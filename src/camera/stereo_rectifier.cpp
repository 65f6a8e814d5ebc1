// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/stereo_rectifier.h>
#include <kys_slam/util/memory_limit.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "camera/plausible.h"

namespace kys_slam {

/// For every pixel of the result, where it comes from: the offset of the upper left of four source
/// pixels, and the weights of the right and lower ones in 1/32. One core does a 752x480 image in
/// 0.8 ms; cv::remap needs 1.2 ms and, by default, threads.
struct StereoRectifier::Maps {
  int width = 0;   // of raw and rectified images
  int height = 0;  //
  std::vector<std::int32_t> offset;
  std::vector<std::uint16_t> weights;  // right | lower << 8

  Maps(const cv::Mat& x, const cv::Mat& y)
      : width(x.cols), height(x.rows), offset(x.total()), weights(x.total()) {
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u) {
        const auto [column, right] = split(x.at<float>(v, u), width);
        const auto [row, lower] = split(y.at<float>(v, u), height);
        const std::size_t i = static_cast<std::size_t>(v) * width + u;
        offset[i] = row * width + column;
        weights[i] = static_cast<std::uint16_t>(right | lower << 8);
      }
    }
  }

  /// Integer part and 1/32 of a coordinate; what lies outside takes the border's value.
  static std::pair<int, int> split(float coordinate, int size) {
    const double inside = std::clamp<double>(coordinate, 0.0, size - 1.0);
    const int fixed = static_cast<int>(std::lround(inside * 32.0));
    const int whole = std::min(fixed / 32, size - 2);
    return {whole, fixed - whole * 32};
  }

  [[nodiscard]] GrayImage apply(const GrayImage& raw) const {
    if (raw.width() != width || raw.height() != height) {
      throw InputError("raw image of another size than its calibration");
    }
    GrayImage rectified(width, height);
    const std::uint8_t* in = raw.data();
    std::uint8_t* out = rectified.data();
    const std::size_t count = offset.size();
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint8_t* upper = in + offset[i];
      const std::uint8_t* under = upper + width;
      const unsigned right = weights[i] & 0xffU;
      const unsigned lower = weights[i] >> 8U;
      const unsigned top = upper[0] * (32 - right) + upper[1] * right;
      const unsigned bottom = under[0] * (32 - right) + under[1] * right;
      out[i] = static_cast<std::uint8_t>((top * (32 - lower) + bottom * lower + 512) >> 10U);
    }
    return rectified;
  }
};

namespace {

void check(const RawCamera& camera, const std::string& name) {
  const auto& d = camera.distortion;
  const bool finite = std::isfinite(camera.cx) && std::isfinite(camera.cy) &&
                      camera.T_b_s.is_finite() &&
                      std::all_of(d.begin(), d.end(), [](double k) { return std::isfinite(k); });
  if (!finite || !std::isfinite(camera.fx) || !std::isfinite(camera.fy) || camera.fx <= 0 ||
      camera.fy <= 0 || camera.width < 2 || camera.height < 2) {
    throw InputError(name + ": calibration with non-finite or non-positive numbers");
  }
  if (camera.lens == LensModel::kEquidistant) {
    if (d.size() != 4) throw InputError(name + ": equidistant distortion needs 4 coefficients");
  } else if (!d.empty() && d.size() != 4 && d.size() != 5 && d.size() != 8) {
    throw InputError(name + ": radial-tangential distortion needs 4, 5 or 8 coefficients");
  }
}

/// Raw pixel of a ray in an equidistant camera, or nothing where the model does not reach.
std::optional<Eigen::Vector2d> project_equidistant(const RawCamera& c, const Eigen::Vector3d& ray) {
  const double r = ray.head<2>().norm();
  const double theta = std::atan2(r, ray.z());
  double bent = theta, slope = 1, power = 1;
  for (std::size_t i = 0; i < 4; ++i) {
    power *= theta * theta;
    bent += c.distortion[i] * power * theta;
    slope += static_cast<double>(2 * i + 3) * c.distortion[i] * power;
  }
  if (!(slope > 0)) return std::nullopt;  // the image folds back onto itself
  const double k = r > 1e-12 ? bent / r : 1 / ray.z();
  return Eigen::Vector2d{c.fx * k * ray.x() + c.cx, c.fy * k * ray.y() + c.cy};
}

/// One equidistant camera as it is seen from the rectified frame.
struct RectifiedView {
  const RawCamera* raw;
  Eigen::Matrix3d R_raw_rectified;

  [[nodiscard]] std::optional<Eigen::Vector2d> source(double u, double v, double f) const {
    const Eigen::Vector3d ray((u - 0.5 * (raw->width - 1)) / f, (v - 0.5 * (raw->height - 1)) / f,
                              1);
    return project_equidistant(*raw, R_raw_rectified * ray);
  }
  /// Whether the rectified image of this focal length has its whole border inside the raw image.
  [[nodiscard]] bool covers(double f) const {
    const auto inside = [&](double u, double v) {
      const auto p = source(u, v, f);
      return p && p->x() >= 0 && p->y() >= 0 && p->x() <= raw->width - 1 &&
             p->y() <= raw->height - 1;
    };
    for (int u = 0; u < raw->width; ++u) {
      if (!inside(u, 0) || !inside(u, raw->height - 1)) return false;
    }
    for (int v = 0; v < raw->height; ++v) {
      if (!inside(0, v) || !inside(raw->width - 1, v)) return false;
    }
    return true;
  }
};

/// The smallest focal length (px) that both views cover, to 1e-6.
double common_focal_length(const RectifiedView& left, const RectifiedView& right,
                           const std::string& name) {
  double low = 0.05 * left.raw->fx, high = 20 * left.raw->fx;
  const auto good = [&](double f) { return left.covers(f) && right.covers(f); };
  if (!good(high)) throw InputError(name + ": the cameras do not look the same way");
  for (int i = 0; i < 60 && high - low > 1e-6; ++i) {
    const double middle = 0.5 * (low + high);
    (good(middle) ? high : low) = middle;
  }
  return high;
}

/// T_right_left, rounded to 1e-9 (rad, m): the formats of calibration files give one rig as
/// different products of matrices, which differ in the last bits; the rectified images should not.
Rigid3 left_to_right(const RawCamera& left, const RawCamera& right) {
  const Rigid3 T_r_l = right.T_b_s.inverse() * left.T_b_s;
  const auto round = [](double value) { return std::round(value * 1e9) * 1e-9 + 0.0; };
  return {Eigen::Matrix3d(T_r_l.R().unaryExpr(round)), T_r_l.t().unaryExpr(round)};
}

cv::Mat camera_matrix(const RawCamera& c) {
  return (cv::Mat_<double>(3, 3) << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
}

cv::Mat to_cv(const Eigen::Matrix3d& R) {
  cv::Mat m(3, 3, CV_64F);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m.at<double>(i, j) = R(i, j);
  }
  return m;
}

Eigen::Matrix3d to_eigen(const cv::Mat& m) {
  Eigen::Matrix3d R;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) R(i, j) = m.at<double>(i, j);
  }
  return R;
}

}  // namespace

StereoRectifier::StereoRectifier(const RawCamera& left, const RawCamera& right,
                                 const std::string& name) {
  check(left, name);
  check(right, name);
  if (left.width != right.width || left.height != right.height) {
    throw InputError(name + ": the two cameras have different resolutions");
  }
  if (left.lens != right.lens) throw InputError(name + ": the two cameras have different lenses");
  constexpr std::size_t kBytesPerPixel = 20;  // both tables, and OpenCV's of one camera
  check_memory(name, kBytesPerPixel * static_cast<std::size_t>(left.width) *
                         static_cast<std::size_t>(left.height));
  if (left.lens == LensModel::kEquidistant) {
    rectify_equidistant(left, right, name);
    return;
  }
  const cv::Size size(left.width, left.height);
  const Rigid3 T_r_l = left_to_right(left, right);
  const cv::Mat t = (cv::Mat_<double>(3, 1) << T_r_l.t().x(), T_r_l.t().y(), T_r_l.t().z());
  const cv::Mat K[2] = {camera_matrix(left), camera_matrix(right)};
  cv::Mat R[2], P[2], Q;
  try {
    cv::stereoRectify(K[0], left.distortion, K[1], right.distortion, size, to_cv(T_r_l.R()), t,
                      R[0], R[1], P[0], P[1], Q, cv::CALIB_ZERO_DISPARITY, 0.0, size);
    for (int i = 0; i < 2; ++i) {
      cv::Mat x, y;
      cv::initUndistortRectifyMap(K[i], i == 0 ? left.distortion : right.distortion, R[i], P[i],
                                  size, CV_32FC1, x, y);
      if (!cv::checkRange(x) || !cv::checkRange(y)) throw InputError(name + ": absurd distortion");
      maps_[i] = std::make_unique<Maps>(x, y);
    }
  } catch (const cv::Exception&) {
    throw InputError(name + ": the cameras cannot be rectified");
  }
  camera_.width = left.width;
  camera_.height = left.height;
  camera_.fx = P[0].at<double>(0, 0);
  camera_.fy = P[0].at<double>(1, 1);
  camera_.cx = P[0].at<double>(0, 2);
  camera_.cy = P[0].at<double>(1, 2);
  camera_.baseline = -P[1].at<double>(0, 3) / P[1].at<double>(0, 0);
  // A rig whose cameras stand one above the other has its shift in P(1,3).
  if (!camera_.is_valid() || std::abs(P[1].at<double>(1, 3)) > 1e-9) {
    throw InputError(name + ": the cameras cannot be rectified (is cam1 to the right of cam0?)");
  }
  require_plausible(camera_, name);
  T_b_c_ =
      left.T_b_s * Rigid3(Eigen::Matrix3d(to_eigen(R[0]).transpose()), Eigen::Vector3d::Zero());
}

StereoRectifier::StereoRectifier(const StereoCamera& given, const RigCorrection& correction,
                                 const std::string& name)
    : camera_(given) {
  const Eigen::Vector3d along(1, correction[RigParameter::kBaselineY],
                              correction[RigParameter::kBaselineZ]);
  camera_.baseline = given.baseline * along.norm() / correction.focal_scale();
  Eigen::Matrix3d R;  // from the given left camera, with the least turn about the baseline
  R.row(0) = along.normalized();
  R.row(1) = Eigen::Vector3d::UnitZ().cross(along).normalized();
  R.row(2) = R.row(0).cross(R.row(1));
  T_b_c_ = Rigid3(Eigen::Matrix3d(R.transpose()), Eigen::Vector3d::Zero());
  const cv::Size size(given.width, given.height);
  std::array<cv::Mat, 2> x{cv::Mat(size, CV_32FC1), cv::Mat(size, CV_32FC1)};
  std::array<cv::Mat, 2> y{cv::Mat(size, CV_32FC1), cv::Mat(size, CV_32FC1)};
  for (int v = 0; v < given.height; ++v) {
    for (int u = 0; u < given.width; ++u) {
      const Eigen::Vector3d ray =
          R.transpose() * Eigen::Vector3d((u - given.cx) / given.fx, (v - given.cy) / given.fy, 1);
      const Eigen::Vector2d ideal = given.project(ray);
      const Eigen::Vector2d from[2] = {correction.measured_left(ideal.x(), ideal.y()),
                                       correction.measured_right(ideal.x(), ideal.y(), ideal.x())};
      for (std::size_t side = 0; side < 2; ++side) {
        x.at(side).at<float>(v, u) = static_cast<float>(from[side].x());
        y.at(side).at<float>(v, u) = static_cast<float>(from[side].y());
      }
    }
  }
  for (std::size_t side = 0; side < 2; ++side) {
    if (!cv::checkRange(x.at(side)) || !cv::checkRange(y.at(side))) {
      throw InputError(name + ": an absurd correction");
    }
    maps_.at(side) = std::make_unique<Maps>(x.at(side), y.at(side));
  }
}

void StereoRectifier::rectify_equidistant(const RawCamera& left, const RawCamera& right,
                                          const std::string& name) {
  const cv::Size size(left.width, left.height);
  const Rigid3 T_r_l = left_to_right(left, right);
  const cv::Mat t = (cv::Mat_<double>(3, 1) << T_r_l.t().x(), T_r_l.t().y(), T_r_l.t().z());
  cv::Mat R[2], P[2], Q;
  try {  // the rotations depend on the rig alone
    cv::stereoRectify(camera_matrix(left), cv::Mat(), camera_matrix(right), cv::Mat(), size,
                      to_cv(T_r_l.R()), t, R[0], R[1], P[0], P[1], Q, cv::CALIB_ZERO_DISPARITY);
  } catch (const cv::Exception&) {
    throw InputError(name + ": the cameras cannot be rectified");
  }
  const Eigen::Vector3d shift = to_eigen(R[1]) * T_r_l.t();
  const RectifiedView views[2] = {{&left, to_eigen(R[0]).transpose()},
                                  {&right, to_eigen(R[1]).transpose()}};
  camera_.width = left.width;
  camera_.height = left.height;
  camera_.fx = camera_.fy = common_focal_length(views[0], views[1], name);
  camera_.cx = 0.5 * (left.width - 1);
  camera_.cy = 0.5 * (left.height - 1);
  camera_.baseline = -shift.x();
  if (!camera_.is_valid() || std::abs(shift.y()) > 1e-9 * shift.norm()) {
    throw InputError(name + ": the cameras cannot be rectified (is the right camera to the right " +
                     "of the left one?)");
  }
  require_plausible(camera_, name);
  for (std::size_t i = 0; i < 2; ++i) {
    cv::Mat x(size, CV_32FC1), y(size, CV_32FC1);
    for (int v = 0; v < size.height; ++v) {
      for (int u = 0; u < size.width; ++u) {
        const auto p = views[i].source(u, v, camera_.fx);
        if (!p) throw InputError(name + ": absurd distortion");
        x.at<float>(v, u) = static_cast<float>(p->x());
        y.at<float>(v, u) = static_cast<float>(p->y());
      }
    }
    maps_[i] = std::make_unique<Maps>(x, y);
  }
  T_b_c_ = left.T_b_s * Rigid3(views[0].R_raw_rectified, Eigen::Vector3d::Zero());
}

StereoRectifier::StereoRectifier(StereoRectifier&&) noexcept = default;
StereoRectifier& StereoRectifier::operator=(StereoRectifier&&) noexcept = default;
StereoRectifier::~StereoRectifier() = default;

GrayImage StereoRectifier::rectify_left(const GrayImage& raw) const {
  return maps_[0]->apply(raw);
}

GrayImage StereoRectifier::rectify_right(const GrayImage& raw) const {
  return maps_[1]->apply(raw);
}

}  // namespace kys_slam
