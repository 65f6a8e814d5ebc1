// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/distance_quantiles.h>
#include <kys_slam/features.h>
#include <kys_slam/image.h>
#include <kys_slam/settings.h>

#include <cstddef>
#include <memory>
#include <string>

namespace kys_slam {

struct ImagePyramid;

inline constexpr const char* kOrbName = "orb";

/// What the system takes for granted of the features of an extractor. The defaults are those of
/// ORB.
struct ExtractorTraits {
  /// Printable, without blanks, at most 255 characters. Maps are refused when they were made with
  /// another one.
  std::string name = kOrbName;
  double scale_factor = 1.2;  ///< between two levels, 1.01 to 4
  int levels = 8;             ///< octaves of keypoints are below this, 1 to 32
  /// Levels are sizes: a feature is compared with features of neighbouring levels only, and the
  /// level at which a landmark is seen follows from its distance. False: levels only say how exact
  /// a position is, and features of all levels are compared.
  bool sizes = true;
  /// Factor on the distance, nearer or farther than its levels say, over which a landmark still
  /// has the same descriptor; 1 to 100.
  double reach = 1;
  /// Keypoints have orientations, and matches must agree about the relative one. False: all angles
  /// are 0.
  bool oriented = true;
  double pixel_sigma = 0.35;  ///< px of level 0, standard deviation of a coordinate, 0.01 to 100
  /// Of its descriptors. Settings in bits are those of ORB; the system uses the distance that is as
  /// strict for this extractor. Empty: the same numbers.
  DistanceQuantiles distances;
};
/// \throws InputError naming the first value that makes no sense.
void check_traits(const ExtractorTraits& traits);

/// Keypoints and descriptors of rectified stereo pairs. A system owns one and calls it from the
/// thread that feeds. The same images must give the same features.
class FeatureExtractor {
 public:
  FeatureExtractor() = default;
  FeatureExtractor(const FeatureExtractor&) = delete;
  FeatureExtractor& operator=(const FeatureExtractor&) = delete;
  virtual ~FeatureExtractor() = default;

  /// The same at every call.
  [[nodiscard]] virtual const ExtractorTraits& traits() const = 0;
  /// Replaces the features of both images. No features is no error. Positions are px of the full
  /// image, at most 16 px outside; angles rad in [0, 2 pi]; at most 65535 features per image.
  /// Descriptors that are floats: `Binariser`.
  virtual void extract(const GrayImage& left, const GrayImage& right, FeatureSet& of_left,
                       FeatureSet& of_right) = 0;
  /// The reduced images of the last pair, for an extractor of the core that has made them; null:
  /// the system makes its own. \param side 0 left, 1 right
  [[nodiscard]] virtual const ImagePyramid* pyramid(std::size_t side) const;
};

/// The extractor that systems use by default: oriented FAST corners with ORB descriptors (ORB-SLAM,
/// Sec. III-C), by the settings `orb.*`; features are ordered by octave. Extracts the two images in
/// parallel. \throws InputError naming the invalid setting.
std::unique_ptr<FeatureExtractor> make_orb_extractor(const Settings& settings = {});

}  // namespace kys_slam
