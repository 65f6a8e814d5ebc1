#include "camera/stereo_rectifier.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace kys_slam {

/// Source positions in 1/32 px: integer part, and an index into OpenCV's table of weights.
struct StereoRectifier::Maps {
  cv::Mat position;  // CV_16SC2
  cv::Mat fraction;  // CV_16UC1

  [[nodiscard]] GrayImage apply(const GrayImage& raw) const {
    GrayImage rectified(position.cols, position.rows);
    const cv::Mat in(raw.height(), raw.width(), CV_8UC1, const_cast<std::uint8_t*>(raw.data()));
    cv::Mat out(rectified.height(), rectified.width(), CV_8UC1, rectified.data());
    cv::remap(in, out, position, fraction, cv::INTER_LINEAR, cv::BORDER_CONSTANT);
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
      camera.fy <= 0 || camera.width <= 0 || camera.height <= 0) {
    throw InputError(name + ": calibration with non-finite or non-positive numbers");
  }
  if (d.size() != 4 && d.size() != 5) {
    throw InputError(name + ": radial-tangential distortion needs 4 or 5 coefficients");
  }
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
  const cv::Size size(left.width, left.height);
  const Rigid3 T_r_l = right.T_b_s.inverse() * left.T_b_s;
  const cv::Mat t = (cv::Mat_<double>(3, 1) << T_r_l.t().x(), T_r_l.t().y(), T_r_l.t().z());
  const cv::Mat K[2] = {camera_matrix(left), camera_matrix(right)};
  cv::Mat R[2], P[2], Q;
  try {
    cv::stereoRectify(K[0], left.distortion, K[1], right.distortion, size, to_cv(T_r_l.R()), t,
                      R[0], R[1], P[0], P[1], Q, cv::CALIB_ZERO_DISPARITY, 0.0, size);
    for (int i = 0; i < 2; ++i) {
      maps_[i] = std::make_unique<Maps>();
      cv::initUndistortRectifyMap(K[i], i == 0 ? left.distortion : right.distortion, R[i], P[i],
                                  size, CV_16SC2, maps_[i]->position, maps_[i]->fraction);
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
  T_b_c_ =
      left.T_b_s * Rigid3(Eigen::Matrix3d(to_eigen(R[0]).transpose()), Eigen::Vector3d::Zero());
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
