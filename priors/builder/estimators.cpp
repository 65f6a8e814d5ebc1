// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/estimators.h"

#include <algorithm>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/video/tracking.hpp>

namespace kys_slam {
namespace {

cv::Mat view(const GrayImage& image) {
  return {image.height(), image.width(), CV_8UC1, const_cast<std::uint8_t*>(image.data())};
}

}  // namespace

ImageOf<float> estimate_disparity(const GrayImage& left, const GrayImage& right_image, bool right) {
  constexpr int kRange = 128;  // px
  cv::Mat a = view(left), b = view(right_image);
  if (right) {
    // The mirrored right view is the left view of the mirrored pair.
    cv::Mat mirrored_left, mirrored_right;
    cv::flip(a, mirrored_left, 1);
    cv::flip(b, mirrored_right, 1);
    a = mirrored_right;
    b = mirrored_left;
  }
  // A margin on the left, so that disparities at the left edge can be searched as well.
  cv::Mat wide_a, wide_b, result;
  cv::copyMakeBorder(a, wide_a, 0, 0, kRange, 0, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(b, wide_b, 0, 0, kRange, 0, cv::BORDER_REPLICATE);
  const auto matcher = cv::StereoSGBM::create(0, kRange, 5, 8 * 25, 32 * 25, 1, 31, 10, 100, 2,
                                              cv::StereoSGBM::MODE_SGBM_3WAY);
  matcher->compute(wide_a, wide_b, result);
  ImageOf<float> disparity(left.width(), left.height());
  for (int y = 0; y < left.height(); ++y) {
    const auto* row = result.ptr<std::int16_t>(y) + kRange;
    for (int x = 0; x < left.width(); ++x) {
      const float d = static_cast<float>(row[right ? left.width() - 1 - x : x]) / 16.0F;
      disparity.at(x, y) = d > 0 ? d : std::numeric_limits<float>::quiet_NaN();
    }
  }
  return disparity;
}

FlowField estimate_flow(const GrayImage& from, const GrayImage& to, int finest_level,
                        const FlowField* seed) {
  const auto dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setFinestScale(finest_level);
  cv::Mat flow;
  if (seed != nullptr) {
    flow.create(from.height(), from.width(), CV_32FC2);
    for (int y = 0; y < from.height(); ++y) {
      auto* row = flow.ptr<cv::Vec2f>(y);
      for (int x = 0; x < from.width(); ++x) row[x] = {seed->u.at(x, y), seed->v.at(x, y)};
    }
  }
  dis->calc(view(from), view(to), flow);
  FlowField field{ImageOf<float>(from.width(), from.height()),
                  ImageOf<float>(from.width(), from.height())};
  for (int y = 0; y < from.height(); ++y) {
    const auto* row = flow.ptr<cv::Vec2f>(y);
    for (int x = 0; x < from.width(); ++x) {
      field.u.at(x, y) = row[x][0];
      field.v.at(x, y) = row[x][1];
    }
  }
  return field;
}

}  // namespace kys_slam
