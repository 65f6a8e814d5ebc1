// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/features.h>
#include <kys_slam/image.h>
#include <kys_slam/settings.h>

#include <memory>

namespace kys_slam {

/// Extracts the features that the system uses: oriented FAST corners with ORB descriptors
/// (ORB-SLAM, Sec. III-C), by the settings `orb.*`. For programs that need the features themselves,
/// or that feed features instead of images (`StereoFrame::left_features`). Keeps its buffers
/// between calls: one instance per thread.
class FeatureExtractor {
 public:
  /// \throws InputError naming the invalid setting.
  explicit FeatureExtractor(const Settings& settings = {});
  FeatureExtractor(FeatureExtractor&&) noexcept;
  FeatureExtractor& operator=(FeatureExtractor&&) noexcept;
  ~FeatureExtractor();

  /// Replaces the content of `features`, ordered by octave. An image without texture gives no
  /// features and no error. The result depends on the image and the settings alone.
  void extract(const GrayImage& image, FeatureSet& features);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
