#pragma once

#include <kys_slam/features.h>
#include <kys_slam/image.h>
#include <kys_slam/settings.h>

#include <memory>

namespace kys_slam {

/// Finds the features that the system finds in an image: oriented FAST corners with ORB
/// descriptors (ORB-SLAM, Sec. III-C), as the settings `orb.*` say. For programs that look at
/// features themselves, or feed them instead of images (`StereoFrame::left_features`). Keeps its
/// buffers between calls; one instance per thread.
class FeatureExtractor {
 public:
  /// \throws InputError naming the setting that makes no sense.
  explicit FeatureExtractor(const Settings& settings = {});
  FeatureExtractor(FeatureExtractor&&) noexcept;
  FeatureExtractor& operator=(FeatureExtractor&&) noexcept;
  ~FeatureExtractor();

  /// Ordered by octave. An image without texture gives none; it is not an error. The result depends
  /// on the image and the settings alone.
  void extract(const GrayImage& image, FeatureSet& features);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
