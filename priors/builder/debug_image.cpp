// SPDX-License-Identifier: BSD-3-Clause
#include "priors/builder/debug_image.h"

#include <kys_slam/prior_format.h>

#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace kys_slam {
namespace {

cv::Vec3b colour_of(std::int32_t instance) {
  const auto h = static_cast<std::uint32_t>(instance) * 2654435761u;
  return {static_cast<std::uint8_t>(64 + (h >> 24) % 192),
          static_cast<std::uint8_t>(64 + (h >> 16) % 192),
          static_cast<std::uint8_t>(64 + (h >> 8) % 192)};
}

/// Flow as colour: direction is hue, length (of `largest`) is brightness. Grey where unknown.
cv::Mat flow_picture(const FlowField& flow, float largest) {
  cv::Mat hsv(flow.u.height(), flow.u.width(), CV_8UC3, cv::Scalar(0, 0, 0)), rgb;
  for (int y = 0; y < hsv.rows; ++y) {
    for (int x = 0; x < hsv.cols; ++x) {
      const float u = flow.u.at(x, y), v = flow.v.at(x, y);
      if (!std::isfinite(u)) {
        hsv.at<cv::Vec3b>(y, x) = {0, 0, 60};
        continue;
      }
      const double angle = std::atan2(v, u) * 90 / CV_PI + 90;
      const double value = 255 * std::min(1.0F, std::sqrt(u * u + v * v) / largest);
      hsv.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(static_cast<int>(angle) % 180), 255,
                                 static_cast<std::uint8_t>(value)};
    }
  }
  cv::cvtColor(hsv, rgb, cv::COLOR_HSV2RGB);
  return rgb;
}

cv::Mat base_picture(const GrayImage& image, int width, int height) {
  cv::Mat rgb(height, width, CV_8UC3, cv::Scalar(40, 40, 40));
  if (!image.empty()) {
    const cv::Mat grey(height, width, CV_8UC1, const_cast<std::uint8_t*>(image.data()));
    cv::cvtColor(grey, rgb, cv::COLOR_GRAY2RGB);
  }
  return rgb;
}

template <typename ColourOf>
void tint(cv::Mat& rgb, const ImageOf<std::uint16_t>& map, ColourOf&& colour) {
  for (int y = 0; y < rgb.rows; ++y) {
    for (int x = 0; x < rgb.cols; ++x) {
      cv::Vec3b& p = rgb.at<cv::Vec3b>(y, x);
      cv::Vec3b c;
      if (map.at(x, y) != 0 && colour(map.at(x, y) - 1, x, y, c)) p = 0.5 * p + 0.5 * c;
    }
  }
}

void title(cv::Mat& picture, const std::string& text, cv::Point at = {8, 20}, double size = 0.55) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, size, {0, 0, 0}, 3, cv::LINE_AA);
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, size, {255, 255, 255}, 1, cv::LINE_AA);
}

std::string text_of(const char* format, double a, double b) {
  char text[96];
  std::snprintf(text, sizeof text, format, a, b);
  return text;
}

void annotate(cv::Mat& picture, const CameraFusion& fusion) {
  const auto shapes = segment_shapes(fusion.priors.runs, fusion.segments.size());
  for (std::size_t k = 0; k < fusion.segments.size(); ++k) {
    if (!fusion.segments[k].thing || fusion.statistics[k].area < 150) continue;
    const SegmentStatistics& s = fusion.statistics[k];
    const cv::Point at(static_cast<int>(shapes[k].u) - 30, static_cast<int>(shapes[k].v));
    title(picture, text_of("C %.2f R %.2f", s.residual, s.radial), at, 0.34);
    title(picture, text_of("Cov %.2f x%.1f", s.coverage, fusion.decisions[k].omega),
          at + cv::Point(0, 12), 0.34);
  }
}

}  // namespace

RgbImage draw_stages(const GrayImage& image, const CameraFusion& fusion,
                     const FusionImages& images) {
  const ImageOf<std::uint16_t>& map = fusion.priors.segment_map;
  const int width = map.width(), height = map.height();
  const cv::Mat base = base_picture(image, width, height);
  std::vector<cv::Mat> panels(6);
  for (cv::Mat& panel : panels) panel = base.clone();
  tint(panels[0], map, [&](int k, int, int, cv::Vec3b& c) {
    c = colour_of(fusion.priors.segments[static_cast<std::size_t>(k)].instance);
    return true;
  });
  title(panels[0], "segments and identities");
  if (fusion.ego_motion) {
    panels[1] = flow_picture(images.predicted, 40);
    panels[2] = flow_picture(images.residual, 5);
    panels[3] = flow_picture(images.drift, 1);
  }
  title(panels[1], "predicted static flow (full at 40 px)");
  title(panels[2], "residual (full at 5 px)");
  title(panels[3], "drift (full at 1 px)");
  tint(panels[4], map, [&](int k, int, int, cv::Vec3b& c) {
    const auto i = static_cast<std::size_t>(k);
    const MotionDecision& d = fusion.decisions[i];
    c = d.radial_only ? cv::Vec3b(255, 160, 0)
        : d.dynamic   ? cv::Vec3b(255, 0, 0)
        : !d.judged   ? cv::Vec3b(90, 90, 90)
                      : cv::Vec3b(0, 200, 0);
    return fusion.segments[i].thing;
  });
  annotate(panels[4], fusion);
  const BackgroundReferences& bg = fusion.background;
  title(panels[4],
        text_of("red moving, orange radial only, grey not judged; m_bg %.2f px, sigma %.2f px",
                bg.m_bg, bg.sigma_par));
  tint(panels[5], map, [&](int k, int x, int y, cv::Vec3b& c) {
    if (!fusion.decisions[static_cast<std::size_t>(k)].dynamic) return false;
    const float mu = fusion.priors.motion.at(x, y);
    c = cv::Vec3b(static_cast<std::uint8_t>(2.55F * mu),
                  static_cast<std::uint8_t>(255 - 2.55F * mu), 0);
    return true;
  });
  title(panels[5], "exported motion (green 0, red 100)");

  RgbImage out(2 * width, 3 * height);
  cv::Mat sheet(3 * height, 2 * width, CV_8UC3, out.data());
  for (int i = 0; i < 6; ++i) {
    panels[static_cast<std::size_t>(i)].copyTo(
        sheet(cv::Rect(i % 2 * width, i / 2 * height, width, height)));
  }
  return out;
}

}  // namespace kys_slam
