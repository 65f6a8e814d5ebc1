// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance.h>
#include <kys_slam/feature_extractor.h>
#include <kys_slam/features.h>
#include <kys_slam/rig_correction.h>
#include <kys_slam/stereo_camera.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "geometry/observation.h"

namespace kys_slam {

/// Features of one image.
inline constexpr std::size_t kMostFeatures = 65535;

/// Assumed standard deviation of a keypoint's coordinates and of its disparity, px of its octave.
/// Measured against exact flow and disparity of simulated sequences: 0.11-0.17 and 0.08-0.12 px,
/// the same at all octaves. The rest is a margin for real lenses and calibrations.
inline constexpr float kPixelSigma = 0.35f;

/// The same for u of keypoints aligned with the patch of their landmark (LandmarkPatches).
/// Residuals in maps of image sequences (tests/measure/evaluate_residuals): u 0.13-0.15 px, v
/// 0.09-0.11 px, disparity 0.08-0.10 px, the same at all octaves, on rendered worlds and on KITTI;
/// on EuRoC 0.20, 0.16, 0.09 px.
inline constexpr float kAlignedSigma = 0.175f;

/// Of features found in images: standard deviations of 0.175 px for u, 0.11 px for v and 0.10 px
/// for the disparity of an aligned keypoint. Corners that are not aligned have about the same
/// ratio: residuals of 0.31-0.39, 0.20-0.29, 0.12-0.17 px.
inline constexpr InformationRatio kImageInformation{2.5f, 3.0f};

/// The levels of keypoints, and what else they and their descriptors are (ExtractorTraits).
struct ScaleLevels {
  std::vector<float> scale;  ///< scale_factor^o, px of level 0 per px of octave o
  float log_factor = 0;      ///< ln(scale_factor)
  bool sizes = true;         ///< ExtractorTraits::sizes
  float reach = 1;           ///< ExtractorTraits::reach
  float pixel_sigma = kPixelSigma;
  std::string extractor = kOrbName;  ///< ExtractorTraits::name
  DistanceQuantiles distances;       ///< ExtractorTraits::distances

  ScaleLevels() = default;
  ScaleLevels(double scale_factor, int levels);
  explicit ScaleLevels(const ExtractorTraits& traits);
  /// Whether keypoints mean the same.
  [[nodiscard]] bool same_levels(const ScaleLevels& o) const {
    return scale == o.scale && log_factor == o.log_factor && sizes == o.sizes && reach == o.reach &&
           pixel_sigma == o.pixel_sigma;
  }
  [[nodiscard]] int levels() const { return static_cast<int>(scale.size()); }
  [[nodiscard]] float inv_sigma(int octave) const { return inv_sigma(octave, pixel_sigma); }
  [[nodiscard]] float inv_sigma(int octave, float sigma) const {
    return 1.0f / (sigma * scale[static_cast<std::size_t>(octave)]);
  }
  /// The octaves that are compared when those from `low` to `high` are expected.
  [[nodiscard]] int lowest(int low) const { return sizes ? low : 0; }
  [[nodiscard]] int highest(int high) const { return sizes ? high : levels() - 1; }
  /// 1/px, by FrameFeatures::noise().
  [[nodiscard]] std::vector<float> inv_sigmas() const;
  /// Octave at which a landmark with this `max_distance` (m) is detected from `distance` (m); 0
  /// where levels are not sizes.
  [[nodiscard]] int predict_octave(float max_distance, float distance) const;
  /// Range of distances (m) in which a landmark observed at `octave` from `distance` (m) can be
  /// matched.
  struct DistanceRange {
    float min, max;
  };
  [[nodiscard]] DistanceRange distance_range(double distance, int octave) const {
    if (!sizes) return {static_cast<float>(distance) / reach, static_cast<float>(distance) * reach};
    const float max = static_cast<float>(distance) * scale[static_cast<std::size_t>(octave)];
    return {max / scale.back() / reach, max * reach};
  }
};

/// Columns and rows in the right image of the features of a left one, px; NaN where there is none.
struct RightPositions {
  RightPositions() = default;
  RightPositions(std::vector<float> columns, std::vector<float> rows = {})
      : u(std::move(columns)), v(std::move(rows)) {}

  std::vector<float> u;
  std::vector<float> v;  ///< measured ones (row_alignment.h); empty: none is
};

/// Features of the left image of one frame with disparities and priors. Made once by the front end,
/// immutable, shared by frame, keyframe and replica. Thinned keyframes have a subset. Positions are
/// those in the perfect pair; what was measured in the images is kept beside when it differs.
class FrameFeatures {
 public:
  FrameFeatures() = default;
  /// \param left, right as measured in the images
  /// \param priors one per keypoint, or empty: no priors for this frame
  /// \param rig correction of what is measured
  FrameFeatures(const StereoCamera& camera, FeatureSet left, RightPositions right,
                std::vector<kys::Prior> priors, const RigCorrection& rig = {});

  /// Features read from a map file, as measured.
  /// \param aligned flags, one per keypoint, or empty: no images
  [[nodiscard]] static FrameFeatures restore(const StereoCamera& camera, FeatureSet left,
                                             RightPositions right, std::vector<kys::Prior> priors,
                                             std::vector<std::uint8_t> aligned,
                                             const RigCorrection& rig);

  /// The same features with another correction.
  [[nodiscard]] FrameFeatures with_rig(const RigCorrection& rig) const;
  [[nodiscard]] const RigCorrection& rig() const { return rig_; }
  /// What was measured in the images.
  [[nodiscard]] RigCorrection::Measured measured(std::size_t i) const {
    if (!measured_.empty()) return measured_[i];
    return {keypoint(i).x, keypoint(i).y, u_right_[i]};
  }
  [[nodiscard]] bool measures_rows() const;
  /// A keypoint position aligned with the patch of its landmark, as measured in the image.
  struct Aligned {
    std::uint32_t feature = 0;
    float u = 0;  ///< px
    float v = 0;  ///< px
  };
  /// The same features with new positions for some; disparities do not change.
  [[nodiscard]] FrameFeatures with_aligned(std::span<const Aligned> aligned) const;
  [[nodiscard]] std::span<const std::uint8_t> aligned() const { return aligned_; }  ///< or empty
  /// The same features with the noise of those found in images (kImageInformation); aligned ones
  /// have it.
  [[nodiscard]] FrameFeatures with_image_noise() const;
  [[nodiscard]] InformationRatio ratio() const {
    return image_noise_ ? kImageInformation : InformationRatio{};
  }
  [[nodiscard]] bool is_aligned(std::size_t i) const {
    return !aligned_.empty() && aligned_[i] != 0;
  }
  /// The features with a non-zero flag, in the same order.
  /// \param keep one per feature
  [[nodiscard]] FrameFeatures subset(std::span<const std::uint8_t> keep) const;
  /// The same features with other priors, one per keypoint or none.
  [[nodiscard]] FrameFeatures with_priors(std::vector<kys::Prior> priors) const;

  [[nodiscard]] std::size_t size() const { return keypoints_.size(); }
  /// Number of features with a disparity.
  [[nodiscard]] int stereo_count() const {
    int count = 0;
    for (std::size_t i = 0; i < size(); ++i) count += has_stereo(i) ? 1 : 0;
    return count;
  }
  [[nodiscard]] const Keypoint& keypoint(std::size_t i) const { return keypoints_[i]; }
  [[nodiscard]] const kys::Descriptor& descriptor(std::size_t i) const {
    return descriptors_.get()[i];
  }
  [[nodiscard]] const kys::Prior& prior(std::size_t i) const {
    return priors_ == nullptr ? kNoPrior : priors_.get()[i];
  }
  [[nodiscard]] std::span<const Keypoint> keypoints() const { return keypoints_; }
  [[nodiscard]] std::span<const kys::Descriptor> descriptors() const {
    return {descriptors_.get(), size()};
  }
  [[nodiscard]] std::span<const kys::Prior> priors() const {
    return {priors_.get(), priors_ == nullptr ? 0 : size()};
  }
  [[nodiscard]] float u_right(std::size_t i) const { return u_right_[i]; }
  /// Kind of noise of a feature: its octave; beyond the octaves, if it is aligned.
  [[nodiscard]] int noise(std::size_t i, const ScaleLevels& scales) const {
    return keypoint(i).octave + (is_aligned(i) ? scales.levels() : 0);
  }
  /// The feature as an observation for the optimisers.
  [[nodiscard]] StereoPixel stereo_pixel(std::size_t i, const ScaleLevels& scales) const {
    const Keypoint& k = keypoint(i);
    return {k.x, k.y, has_stereo(i) ? u_right(i) : StereoPixel{}.u_right,
            scales.inv_sigma(k.octave, is_aligned(i) ? kAlignedSigma : scales.pixel_sigma),
            ratio()};
  }
  /// m, along the optical axis; negative without a stereo match.
  [[nodiscard]] float depth(std::size_t i) const {
    return has_stereo(i) ? static_cast<float>(bf_ / (keypoint(i).x - u_right_[i])) : -1.0f;
  }
  [[nodiscard]] bool has_stereo(std::size_t i) const { return keypoint(i).x > u_right_[i]; }

  /// Calls f(i) for the features in the square of half side `radius` px around (u, v) whose octave
  /// lies in [min_octave, max_octave], in an order that depends on the features alone.
  template <typename F>
  void for_each_near(float u, float v, float radius, int min_octave, int max_octave, F&& f) const;

 private:
  static constexpr int kColumns = 64;
  static constexpr int kRows = 32;
  static inline const kys::Prior kNoPrior{};

  void fill_cells();
  void correct(std::size_t i);
  [[nodiscard]] int column_of(const Keypoint& k) const {
    return std::clamp(static_cast<int>(k.x * cell_width_inv_), 0, kColumns - 1);
  }

  std::vector<Keypoint> keypoints_;
  // Lists shared by the variants of one frame; pointers to their first elements.
  std::shared_ptr<const kys::Descriptor> descriptors_;
  std::shared_ptr<const kys::Prior> priors_;  // null: no priors for this frame
  std::vector<float> u_right_;
  std::vector<RigCorrection::Measured> measured_;  // empty: what the keypoints and u_right_ say
  std::vector<std::uint8_t> aligned_;              // flags, or empty: none is
  bool image_noise_ = false;
  RigCorrection rig_;         // contained in the keypoints and u_right_
  double bf_ = 0;             // px m, of the camera
  float cell_width_inv_ = 0;  // 1/px
  float cell_height_inv_ = 0;
  // Feature indices grouped by cell, row by row, and where each cell starts. A subset has few
  // features and is kept for long: it has starts of rows only.
  std::vector<std::uint16_t> cell_feature_;
  std::vector<std::uint16_t> cell_start_;  // kRows*starts_per_row_ + 1 entries
  int starts_per_row_ = kColumns;
};

template <typename F>
void FrameFeatures::for_each_near(float u, float v, float radius, int min_octave, int max_octave,
                                  F&& f) const {
  if (cell_start_.empty()) return;
  // Conversions of far-away coordinates are clamped while they are still floats.
  const auto column = [&](float x) {
    return static_cast<int>(std::clamp(x * cell_width_inv_, -1.0f, static_cast<float>(kColumns)));
  };
  const auto line = [&](float y) {
    return static_cast<int>(std::clamp(y * cell_height_inv_, -1.0f, static_cast<float>(kRows)));
  };
  const int c0 = std::max(0, column(u - radius));
  const int c1 = std::min(kColumns - 1, column(u + radius));
  const int r0 = std::max(0, line(v - radius));
  const int r1 = std::min(kRows - 1, line(v + radius));
  const bool whole_rows = starts_per_row_ == 1;
  const int begin = whole_rows ? 0 : c0;
  const int end = whole_rows ? 1 : c1 + 1;
  for (int r = r0; r <= r1; ++r) {
    // Cells of one row are neighbours in the list, so a row of cells is one run.
    if (c0 > c1) break;
    const int row = r * starts_per_row_;
    const std::size_t first = cell_start_[static_cast<std::size_t>(row + begin)];
    const std::size_t last = cell_start_[static_cast<std::size_t>(row + end)];
    for (std::size_t k = first; k < last; ++k) {
      const std::size_t i = cell_feature_[k];
      const Keypoint& keypoint = keypoints_[i];
      if (whole_rows && (column_of(keypoint) < c0 || column_of(keypoint) > c1)) continue;
      if (keypoint.octave < min_octave || keypoint.octave > max_octave) continue;
      if (std::abs(keypoint.x - u) > radius || std::abs(keypoint.y - v) > radius) continue;
      f(i);
    }
  }
}

}  // namespace kys_slam
