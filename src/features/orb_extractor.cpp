// SPDX-License-Identifier: BSD-3-Clause
#include "features/orb_extractor.h"

#include <kys/portable_math.h>
#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "features/corner_detector.h"
#include "features/orb_descriptor.h"
#include "features/quadtree.h"

namespace kys_slam {

void describe(kys::OptionList& list, OrbOptions& o) {
  list.add("orb.features", o.features, {1, 60000}, "", "keypoints wanted per image");
  list.add("orb.scale_factor", o.scale_factor, {1.01, 4}, "", "size ratio of two pyramid levels");
  list.add("orb.levels", o.levels, {1, 32}, "", "pyramid levels");
  list.add("orb.fast_threshold", o.fast_threshold, {1, 254}, "grey levels", "FAST threshold");
  list.add("orb.fast_min_threshold", o.fast_min_threshold, {1, 254}, "grey levels",
           "FAST threshold for cells without a corner at fast_threshold");
  list.add("orb.subpixel", o.subpixel, "sub-pixel positions of corners");
  list.require(o.fast_threshold >= o.fast_min_threshold,
               "orb.fast_threshold must be at least orb.fast_min_threshold");
}

namespace {

constexpr int kCell = 35;  // px, cells of the two-threshold rule

/// Corners wanted on every level: a geometric series, the area of the levels.
std::vector<int> share_out(const OrbOptions& options) {
  std::vector<int> wanted;
  const double ratio = 1 / options.scale_factor;
  double share = options.features * (1 - ratio) / (1 - kys::portable::pow(ratio, options.levels));
  int sum = 0;
  for (int level = 0; level + 1 < options.levels; ++level, share *= ratio) {
    wanted.push_back(static_cast<int>(std::lround(share)));
    sum += wanted.back();
  }
  wanted.push_back(std::max(0, options.features - sum));
  return wanted;
}

}  // namespace

struct OrbExtractor::Impl {
  OrbOptions options;
  std::vector<int> wanted;  // corners per level
  ImagePyramid pyramid;
  PyramidBuilder pyramid_builder;
  CornerDetector detector;
  DescriptorBlur blur;
  std::vector<GrayImage> blurred;  // per level: sizes stay the same from call to call
  std::vector<Corner> corners;

  void extract_level(std::size_t level, FeatureSet& features) {
    const GrayImage& image = pyramid.levels[level];
    detector.detect(image, {options.fast_threshold, options.fast_min_threshold, kOrbMargin, kCell},
                    corners);
    if (corners.empty()) return;
    const std::vector<Corner> kept =
        distribute(corners, kOrbMargin, image.width() - kOrbMargin, kOrbMargin,
                   image.height() - kOrbMargin, wanted[level]);
    blur.apply(image, blurred[level]);
    for (const Corner& corner : kept) {
      const Orientation turn = orientation(image, corner.x, corner.y);
      std::array<float, 2> shift{};
      if (options.subpixel) shift = detector.subpixel(corner);
      const Eigen::Vector2f at = pyramid.to_full(level, static_cast<float>(corner.x) + shift[0],
                                                 static_cast<float>(corner.y) + shift[1]);
      Keypoint keypoint;
      keypoint.x = at.x();
      keypoint.y = at.y();
      keypoint.octave = static_cast<std::uint8_t>(level);
      keypoint.response = corner.score;
      keypoint.angle = turn.angle();
      features.keypoints.push_back(keypoint);
      features.descriptors.push_back(orb_descriptor(blurred[level], corner.x, corner.y, turn));
    }
  }
};

OrbExtractor::OrbExtractor(const OrbOptions& options) : impl_(std::make_unique<Impl>()) {
  check_options(options);
  impl_->options = options;
  impl_->wanted = share_out(options);
}
OrbExtractor::~OrbExtractor() = default;
OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept = default;
OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept = default;

void OrbExtractor::extract(const GrayImage& image, FeatureSet& features) {
  features.clear();
  if (image.empty()) return;
  const OrbOptions& options = impl_->options;
  // Features of keyframes are kept as they are: without capacity for more. The last split of a tree
  // may leave three too many.
  const auto most = static_cast<std::size_t>(options.features + 3 * options.levels);
  features.keypoints.reserve(most);
  features.descriptors.reserve(most);
  impl_->pyramid_builder.build(image, options.scale_factor, options.levels, impl_->pyramid);
  impl_->blurred.resize(impl_->pyramid.levels.size());
  for (std::size_t level = 0; level < impl_->pyramid.levels.size(); ++level) {
    impl_->extract_level(level, features);
  }
}

const ImagePyramid& OrbExtractor::pyramid() const {
  return impl_->pyramid;
}

}  // namespace kys_slam
