// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <atomic>
#include <cstddef>

#include "map/map.h"

namespace kys_slam {

struct StereoCalibrationOptions {
  bool enabled = true;
  int keyframes = 20;         ///< in the map at the first estimate
  double significance = 2.5;  ///< standard deviations by which the offset must differ
  /// px, standard deviation of the estimate in addition to that from noise, in a map of `keyframes`
  /// keyframes: patches that contain two surfaces have biased disparities. The first estimates on
  /// 30 rendered sequences with zero true offset have a root mean square of 0.022 px. The worst is
  /// 0.053 px (`hall` at 376x240 px), which this rejects. Errors of more places cancel: it falls
  /// with the square root of the number of keyframes, down to 0.7 times. Estimates on the same
  /// sequences have a root mean square of 0.015 px at 40 keyframes, the worst is 0.040 px; with the
  /// newest 80 keyframes 0.013 px (`street` 0.018 px), the worst 0.039 px.
  double systematic = 0.026;
  double max_correction = 1;  ///< px; a larger estimate is a failure and is not applied
  int min_observers = 3;      ///< keyframes that observe a landmark used here
};
/// For check_options().
void describe(kys::OptionList& list, StereoCalibrationOptions& options);

/// A constant error of all disparities, estimated from the map.
struct DisparityOffset {
  double offset = 0;  ///< px, to be added to the present disparities
  double sigma = 0;   ///< px, standard deviation of the estimate; 0: no estimate
};

/// Estimates the disparity offset. The principal points of a real rig are not known better than to
/// 0.1 px. Their difference adds to every disparity and changes the scale of the map by offset /
/// disparity. Several views of a landmark determine its distance up to one common scale. So a line
/// through (inverse distance, measured disparity) of many landmarks has the scale as its slope and
/// the offset as its intercept. The estimate is the maximum of the profile likelihood: bundle
/// adjustments of the whole map at offsets -h, 0, +h, and the vertex of the parabola through their
/// costs; if it is not near zero, the same again around it. Costs are robust and use disparities of
/// fine octaves only: at depth edges patches contain two surfaces, with a bias to the nearer one
/// that grows with the octave. The noise level comes from the residuals.
DisparityOffset estimate_disparity_offset(const Map& map, const StereoCalibrationOptions& options,
                                          const std::atomic<bool>* stop = nullptr);

/// Decides when to estimate, applies a significant offset to the map, and adjusts the whole map
/// then. It estimates from the whole map when it has 1, 2 and 8 times `keyframes`, which bounds the
/// cost. The first keyframes are close together, and where the lens distortion is not exact the
/// error is not the same everywhere: a later estimate can refine or revert an earlier one. A run
/// that ends before the third estimate has one more at its end.
class StereoCalibration {
 public:
  explicit StereoCalibration(const StereoCalibrationOptions& options)
      : options_(checked(options)) {}
  /// Returns whether the map was changed.
  bool update(Map& map, const std::atomic<bool>* stop = nullptr);
  /// At the end of a run: one more estimate from the whole map, unless the third was made or the
  /// map has hardly grown since the one before. What was not significant in a few keyframes may be
  /// now. Returns whether the map was changed.
  bool finish(Map& map, const std::atomic<bool>* stop = nullptr);

 private:
  bool look(Map& map, bool last, const std::atomic<bool>* stop);

  StereoCalibrationOptions options_;
  std::size_t looks_ = 0;
  std::size_t seen_ = 0;  ///< keyframes at the latest estimate
};

}  // namespace kys_slam
