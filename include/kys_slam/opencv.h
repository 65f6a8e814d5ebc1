// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// For programs that use OpenCV. No other public header needs OpenCV.
#include <kys_slam/error.h>
#include <kys_slam/image_view.h>

#include <opencv2/core/mat.hpp>

namespace kys_slam {

/// A view of a cv::Mat of type CV_8UC1, CV_16UC1 or CV_8UC3 (blue first), without a copy: the
/// matrix must outlive the view. \throws InputError for other types.
inline ImageView view_of(const cv::Mat& image) {
  ImageView view;
  switch (image.type()) {
    case CV_8UC1:
      view.format = PixelFormat::kGray8;
      break;
    case CV_16UC1:
      view.format = PixelFormat::kGray16;
      break;
    case CV_8UC3:
      view.format = PixelFormat::kBgr8;
      break;
    default:
      throw InputError("an image that is neither 8-bit or 16-bit grey nor 8-bit colour");
  }
  view.data = image.data;
  view.width = image.cols;
  view.height = image.rows;
  view.row_step = static_cast<std::ptrdiff_t>(image.step[0]);
  return view;
}

}  // namespace kys_slam
