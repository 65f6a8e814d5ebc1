#include "features/orb_extractor.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
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
  list.add("orb.moving_keypoints", o.moving_keypoints, {0, 60000}, "",
           "most keypoints on an instance that is believed to move (mode verified)");
  list.add("orb.static_share", o.static_share, {0, 1}, "",
           "of the keypoints, wanted outside such instances; weaker corners fill it up");
  list.require(o.fast_threshold >= o.fast_min_threshold,
               "orb.fast_threshold must be at least orb.fast_min_threshold");
}

namespace {

constexpr int kCell = 35;      // px, cells of the two-threshold rule
constexpr int kEdgeCells = 2;  // of SparseRegions

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
  struct Found {
    Corner corner;
    std::uint8_t level = 0;
    Orientation turn;
    std::array<float, 2> shift{};  // px of the level, to the sub-pixel position
    std::int32_t region = -1;      // none
    bool edge = false;             // of its region
  };
  std::vector<Found> found;  // by level

  [[nodiscard]] std::vector<Corner> spread(const std::vector<Corner>& from, std::size_t level,
                                           int count) const {
    const GrayImage& image = pyramid.levels[level];
    return distribute(from, kOrbMargin, image.width() - kOrbMargin, kOrbMargin,
                      image.height() - kOrbMargin, count);
  }

  [[nodiscard]] Eigen::Vector2i pixel_of(std::size_t level, const Corner& corner) const {
    const Eigen::Vector2f at = pyramid.to_full(level, corner.x, corner.y);
    return (at.array() + 0.5f).floor().cast<int>();
  }
  [[nodiscard]] std::int32_t region_of(const SparseRegions& sparse, std::size_t level,
                                       const Corner& corner) const {
    const Eigen::Vector2i at = pixel_of(level, corner);
    return sparse.at(at.x(), at.y());
  }

  /// Where few corners of a level are outside the regions, chooses them anew, weak ones too.
  void refill(const SparseRegions& sparse, std::size_t level, std::vector<Corner>& outside) {
    const int least = static_cast<int>(options.static_share * wanted[level]);
    if (static_cast<int>(outside.size()) >= least) return;
    const auto in_region = [&](const Corner& c) { return region_of(sparse, level, c) >= 0; };
    std::erase_if(corners, in_region);
    if (static_cast<int>(corners.size()) < least) {
      detector.collect_weak(corners);
      std::erase_if(corners, in_region);
    }
    if (!corners.empty()) outside = spread(corners, level, least);
  }

  Found& find(std::size_t level, const Corner& corner) {
    Found& f = found.emplace_back();
    f.corner = corner;
    f.level = static_cast<std::uint8_t>(level);
    f.turn = orientation(pyramid.levels[level], corner.x, corner.y);
    if (options.subpixel) f.shift = detector.subpixel(corner);
    return f;
  }

  void find_level(std::size_t level, const SparseRegions& sparse) {
    detector.detect(pyramid.levels[level],
                    {options.fast_threshold, options.fast_min_threshold, kOrbMargin, kCell},
                    corners);
    if (corners.empty()) return;
    std::vector<Corner> kept = spread(corners, level, wanted[level]);
    if (!sparse.empty()) {
      const auto inside = std::stable_partition(kept.begin(), kept.end(), [&](const Corner& c) {
        return region_of(sparse, level, c) < 0;
      });
      for (auto c = inside; c != kept.end(); ++c) {
        const Eigen::Vector2i at = pixel_of(level, *c);
        Found& f = find(level, *c);
        f.region = sparse.at(at.x(), at.y());
        f.edge = !sparse.is_interior(at.x(), at.y(), kEdgeCells);
      }
      const bool any = inside != kept.end();
      kept.erase(inside, kept.end());
      if (any) refill(sparse, level, kept);
    }
    for (const Corner& corner : kept) find(level, corner);
  }

  /// Drops what is found in a region beyond `moving_keypoints`.
  void thin_out() {
    std::vector<std::uint32_t> inside;
    for (std::uint32_t i = 0; i < found.size(); ++i) {
      if (found[i].region >= 0) inside.push_back(i);
    }
    const auto rank = [&](std::uint32_t i) {
      return std::tuple(found[i].region, found[i].edge, -found[i].turn.angle(), i);
    };
    std::sort(inside.begin(), inside.end(), [&](auto a, auto b) { return rank(a) < rank(b); });
    std::vector<std::uint8_t> dropped(found.size(), 0);
    int count = 0;
    for (std::size_t k = 0; k < inside.size(); ++k) {
      count = k > 0 && found[inside[k]].region == found[inside[k - 1]].region ? count + 1 : 1;
      if (count > options.moving_keypoints) dropped[inside[k]] = 1;
    }
    std::size_t left = 0;
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (dropped[i] == 0) found[left++] = found[i];
    }
    found.resize(left);
  }

  void describe_all(FeatureSet& features) {
    std::size_t blurred_level = pyramid.levels.size();  // none yet
    for (const Found& f : found) {
      const std::size_t level = f.level;
      if (level != blurred_level) blur.apply(pyramid.levels[level], blurred[level]);
      blurred_level = level;
      const Eigen::Vector2f at = pyramid.to_full(level, static_cast<float>(f.corner.x) + f.shift[0],
                                                 static_cast<float>(f.corner.y) + f.shift[1]);
      Keypoint keypoint;
      keypoint.x = at.x();
      keypoint.y = at.y();
      keypoint.octave = f.level;
      keypoint.response = f.corner.score;
      keypoint.angle = f.turn.angle();
      features.keypoints.push_back(keypoint);
      features.descriptors.push_back(
          orb_descriptor(blurred[level], f.corner.x, f.corner.y, f.turn));
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

void OrbExtractor::extract(const GrayImage& image, FeatureSet& features,
                           const SparseRegions& sparse) {
  features.clear();
  if (image.empty()) return;
  const OrbOptions& options = impl_->options;
  // Features of keyframes are kept as they are: without room for more. The last split of a tree
  // may leave three too many.
  const auto most = static_cast<std::size_t>(options.features + 3 * options.levels);
  features.keypoints.reserve(most);
  features.descriptors.reserve(most);
  impl_->pyramid_builder.build(image, options.scale_factor, options.levels, impl_->pyramid);
  impl_->blurred.resize(impl_->pyramid.levels.size());
  impl_->found.clear();
  for (std::size_t level = 0; level < impl_->pyramid.levels.size(); ++level) {
    impl_->find_level(level, sparse);
  }
  if (!sparse.empty()) impl_->thin_out();
  impl_->describe_all(features);
}

const ImagePyramid& OrbExtractor::pyramid() const {
  return impl_->pyramid;
}

}  // namespace kys_slam
