#pragma once

#include <kys/option_list.h>
#include <kys_slam/features.h>
#include <kys_slam/image.h>

#include <memory>

#include "features/pyramid.h"

namespace kys_slam {

/// Settings of the ORB extractor (ORB-SLAM, Sec. III-C).
struct OrbOptions {
  int features = 2000;         ///< keypoints wanted per image
  double scale_factor = 1.2;   ///< between two pyramid levels
  int levels = 8;              ///< pyramid levels
  int fast_threshold = 20;     ///< grey levels
  int fast_min_threshold = 7;  ///< grey levels, used in cells where the first finds nothing
  /// Positions to a fraction of a pixel, from the scores around a corner (halves the error of
  /// matched corners: 0.45 to 0.26 px rms on KITTI images moved by known amounts, 0.49 to 0.32 on
  /// EuRoC). Orientation and descriptor stay at the pixel.
  bool subpixel = true;
};
/// For check_options().
void describe(kys::OptionList& list, OrbOptions& options);

/// Extracts oriented FAST corners with steered BRIEF descriptors: image pyramid, FAST with two
/// thresholds, quadtree distribution, intensity-centroid orientation, 256-bit rotated BRIEF on a
/// blurred image. Keeps its buffers between calls; one instance per thread. The result depends on
/// the image and the options alone.
class OrbExtractor {
 public:
  explicit OrbExtractor(const OrbOptions& options);
  ~OrbExtractor();
  OrbExtractor(OrbExtractor&&) noexcept;
  OrbExtractor& operator=(OrbExtractor&&) noexcept;

  /// Fills `features`, ordered by octave and then as the quadtree leaves them. An image without
  /// texture gives none; it is not an error.
  void extract(const GrayImage& image, FeatureSet& features);

  /// Pyramid of the last image extracted; valid until the next call.
  [[nodiscard]] const ImagePyramid& pyramid() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
