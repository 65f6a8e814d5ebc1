// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_file.h>

#include <array>
#include <cstdint>
#include <vector>

#include "simulator/common/feature_path.h"
#include "simulator/common/rng.h"
#include "simulator/features/boxes.h"
#include "simulator/features/landmarks.h"

namespace kys_slam::simulator {

inline constexpr double kMissed = 0.15;  // share of the features of one image missing in the other

/// Number of landmarks that an image shows of each octave: the same density at every scale.
OctaveCounts feature_quota(const FeaturePath& path, const FeatureOptions& options);

/// The features of one image, as a frame holds them.
struct FeatureColumns {
  FeatureSet& set;
  std::vector<std::int32_t>& ids;
  std::vector<DescriptorOrigin>& origins;
};

/// Detects landmarks in images and measures them, with errors. The result depends on the seed and
/// the frame alone.
class FeatureDetector {
 public:
  /// Keeps references to all arguments.
  /// \param pair  moves the keypoints; null: the cameras are those of the path
  FeatureDetector(const FeaturePath& path, const FeatureOptions& options,
                  const std::vector<FeatureObject>& objects, const LandmarkMap& landmarks,
                  const TruePair* pair = nullptr);

  /// The features of one image, outliers included.
  /// \param by_strength  landmarks in view, strongest first
  /// \param raster  the objects in the image; null: there are none
  void observe(std::size_t frame, int camera, const std::vector<Sight>& by_strength,
               const BoxRaster* raster, FeatureColumns out) const;

 private:
  [[nodiscard]] std::vector<Sight> detect(std::size_t frame, int camera,
                                          const std::vector<Sight>& by_strength) const;
  [[nodiscard]] bool finds_on_object(const Sight& s, std::size_t frame, int camera) const;
  void measure(std::size_t frame, int camera, const std::vector<Sight>& found,
               FeatureColumns out) const;
  [[nodiscard]] kys::Descriptor make_descriptor(std::int32_t id, DescriptorOrigin& origin) const;
  [[nodiscard]] Eigen::Vector3d wander(const Sight& sight) const;
  [[nodiscard]] Eigen::Vector2d image_of(const Sight& sight, int camera) const;
  [[nodiscard]] Eigen::Vector2d lens_error(int camera, const Eigen::Vector2d& p) const;
  void add_outliers(int count, Rng& rng, const BoxRaster* raster, FeatureColumns out) const;

  const FeaturePath& path_;
  const FeatureOptions& options_;
  const std::vector<FeatureObject>& objects_;
  const LandmarkMap& landmarks_;
  const TruePair* pair_;
  OctaveCounts quota_;
  std::array<Eigen::Matrix<double, 2, 6>, 2> lenses_;  ///< px: quadratics over the image, -1 to 1
};

}  // namespace kys_slam::simulator
