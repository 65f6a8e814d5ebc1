#include "features/orb_extractor.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "features/fast_score.h"
#include "features/orb_descriptor.h"
#include "features/quadtree.h"

namespace kys_slam {

namespace {

constexpr int kCell = 35;            // px, cells of the two-threshold rule
constexpr int kMargin = kOrbMargin + 1;  // px: the descriptor's patch, rounding included

void require(bool condition, const char* what) {
  if (!condition) throw InputError(what);
}

/// Corners wanted on every level: a geometric series, the area of the levels.
std::vector<int> share_out(const OrbOptions& options) {
  std::vector<int> wanted;
  const double ratio = 1 / options.scale_factor;
  double share = options.features * (1 - ratio) / (1 - std::pow(ratio, options.levels));
  int sum = 0;
  for (int level = 0; level + 1 < options.levels; ++level, share *= ratio) {
    wanted.push_back(static_cast<int>(std::lround(share)));
    sum += wanted.back();
  }
  wanted.push_back(std::max(0, options.features - sum));
  return wanted;
}

void build_pyramid(const GrayImage& image, const OrbOptions& options, ImagePyramid& pyramid) {
  pyramid.levels.resize(static_cast<std::size_t>(options.levels));
  pyramid.levels[0] = image;
  double scale = 1;
  for (std::size_t level = 1; level < pyramid.levels.size(); ++level) {
    scale *= options.scale_factor;
    const int width = static_cast<int>(std::lround(image.width() / scale));
    const int height = static_cast<int>(std::lround(image.height() / scale));
    GrayImage& to = pyramid.levels[level];
    GrayImage& from = pyramid.levels[level - 1];
    if (width < 1 || height < 1 || from.empty()) {
      to = GrayImage();
      continue;
    }
    if (to.width() != width || to.height() != height) to = GrayImage(width, height);
    const cv::Mat source(from.height(), from.width(), CV_8U, from.data());
    cv::Mat target(height, width, CV_8U, to.data());
    cv::resize(source, target, target.size(), 0, 0, cv::INTER_LINEAR);
  }
}

}  // namespace

void OrbOptions::check() const {
  require(features >= 1 && features <= 60000, "orb.features must be between 1 and 60000");
  require(scale_factor > 1 && scale_factor <= 4, "orb.scale_factor must be above 1 and at most 4");
  require(levels >= 1 && levels <= 32, "orb.levels must be between 1 and 32");
  require(fast_min_threshold >= 1, "orb.fast_min_threshold must be at least 1");
  require(fast_threshold >= fast_min_threshold && fast_threshold <= 254,
          "orb.fast_threshold must be between orb.fast_min_threshold and 254");
}

Eigen::Vector2f ImagePyramid::to_level(std::size_t octave, float x, float y) const {
  const GrayImage& full = levels[0];
  const GrayImage& level = levels[octave];
  const float sx = static_cast<float>(level.width()) / static_cast<float>(full.width());
  const float sy = static_cast<float>(level.height()) / static_cast<float>(full.height());
  return {(x + 0.5f) * sx - 0.5f, (y + 0.5f) * sy - 0.5f};
}

Eigen::Vector2f ImagePyramid::to_full(std::size_t octave, float x, float y) const {
  const GrayImage& full = levels[0];
  const GrayImage& level = levels[octave];
  const float sx = static_cast<float>(full.width()) / static_cast<float>(level.width());
  const float sy = static_cast<float>(full.height()) / static_cast<float>(level.height());
  return {(x + 0.5f) * sx - 0.5f, (y + 0.5f) * sy - 0.5f};
}

struct OrbExtractor::Impl {
  OrbOptions options;
  std::vector<int> wanted;  // corners per level
  ImagePyramid pyramid;
  GrayImage score;
  GrayImage blurred;
  std::vector<Corner> corners;

  void extract_level(std::size_t level, FeatureSet& features) {
    const GrayImage& image = pyramid.levels[level];
    if (image.width() <= 2 * kMargin || image.height() <= 2 * kMargin) return;
    fast_score_map(image, options.fast_min_threshold, kMargin - 1, score);
    select_corners(score, options.fast_threshold, kMargin, kCell, corners);
    if (corners.empty()) return;
    const std::vector<Corner> kept =
        distribute(corners, kMargin, image.width() - kMargin, kMargin, image.height() - kMargin,
                   wanted[level]);
    blur_for_descriptors(image, blurred);
    for (const Corner& corner : kept) {
      Keypoint keypoint;
      const Eigen::Vector2f at = pyramid.to_full(level, corner.x, corner.y);
      keypoint.x = at.x();
      keypoint.y = at.y();
      keypoint.octave = static_cast<std::uint8_t>(level);
      keypoint.response = corner.score;
      keypoint.angle = corner_angle(image, corner.x, corner.y);
      features.descriptors.push_back(
          orb_descriptor(blurred, corner.x, corner.y, keypoint.angle));
      features.keypoints.push_back(keypoint);
    }
  }
};

OrbExtractor::OrbExtractor(const OrbOptions& options) : impl_(std::make_unique<Impl>()) {
  options.check();
  impl_->options = options;
  impl_->wanted = share_out(options);
}
OrbExtractor::~OrbExtractor() = default;
OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept = default;
OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept = default;

void OrbExtractor::extract(const GrayImage& image, FeatureSet& features) {
  features.clear();
  if (image.empty()) return;
  build_pyramid(image, impl_->options, impl_->pyramid);
  for (std::size_t level = 0; level < impl_->pyramid.levels.size(); ++level) {
    impl_->extract_level(level, features);
  }
}

const ImagePyramid& OrbExtractor::pyramid() const { return impl_->pyramid; }

}  // namespace kys_slam
