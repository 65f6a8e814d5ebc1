// SPDX-License-Identifier: BSD-3-Clause
// A segmentation network by OpenCV's dnn module; without OpenCV (WITH_OPENCV_DNN) there is none.
#pragma once

#include <kys_slam/error.h>
#include <kys_slam/segment_image.h>

#include <functional>
#include <map>
#include <memory>
#include <string>

using SegmentPointer = std::shared_ptr<kys_slam::SegmentImage>;
using Segment = std::function<SegmentPointer(const kys_slam::GrayImage&)>;

#ifdef WITH_OPENCV_DNN
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>

/// The segments of class logits (1, classes, height, width) of the size of the image.
inline SegmentPointer best_classes(const cv::Mat& logits, const kys_slam::GrayImage& image) {
  if (logits.dims != 4 || logits.size[2] != image.height() || logits.size[3] != image.width()) {
    throw kys_slam::InputError("the network's output has not the size of the image");
  }
  auto found = std::make_shared<kys_slam::SegmentImage>();
  found->map = kys_slam::ImageOf<std::uint16_t>(image.width(), image.height());
  const auto* values = logits.ptr<float>();
  std::map<int, std::uint16_t> numbers;  // of segments, by class
  for (std::size_t i = 0; i < image.size(); ++i) {
    int best = 0;
    for (int k = 1; k < logits.size[1]; ++k) {
      if (values[k * image.size() + i] > values[best * image.size() + i]) best = k;
    }
    const auto [entry, is_new] = numbers.emplace(best, found->segments.size() + 1);
    if (is_new) found->segments.emplace_back().label = static_cast<std::uint16_t>(best);
    found->map.data()[i] = entry->second;
  }
  return found;
}

inline Segment open_network(const std::string& file) {
  return [net = cv::dnn::readNetFromONNX(file)](const kys_slam::GrayImage& image) mutable {
    const cv::Mat grey(image.height(), image.width(), CV_8U,
                       const_cast<std::uint8_t*>(image.data()));
    cv::Mat rgb;
    cv::cvtColor(grey, rgb, cv::COLOR_GRAY2RGB);
    net.setInput(cv::dnn::blobFromImage(rgb, 1 / 255.0));
    return best_classes(net.forward(), image);
  };
}
#else
inline Segment open_network(const std::string& file) {
  throw kys_slam::InputError(file + ": networks need OpenCV, which was not found");
}
#endif
