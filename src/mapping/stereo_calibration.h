#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>

#include <atomic>

#include "map/map.h"

namespace kys_slam {

struct StereoCalibrationOptions {
  bool enabled = true;
  int keyframes = 20;  ///< in the map when the offset is first looked for; again at twice that
  double significance = 2.5;  ///< standard deviations by which it has to differ
  /// px, standard deviation of the estimate beside that from noise: patches that see two surfaces
  /// have disparities that lean to one side. First looks at 9 rendered sequences whose true offset
  /// is zero have a root mean square of 0.022; the worst, a hall at 376x240, is 0.056 off
  /// sequential and 0.07 pipelined, which this keeps out.
  double systematic = 0.026;
  double max_correction = 1;  ///< px, more is no calibration error but a failure
  int min_observers = 3;      ///< keyframes that see a landmark used here
};
/// For check_options().
void describe(kys::OptionList& list, StereoCalibrationOptions& options);

/// A constant error of all disparities, as the map itself shows it.
struct DisparityOffset {
  double offset = 0;  ///< px, to be added to the disparities as they are now
  double sigma = 0;   ///< px, standard deviation of the estimate; 0: no estimate
};

/// Estimates the disparity offset: the principal points of a real rig's cameras are never known to
/// better than a tenth of a pixel, and their difference adds to every disparity, which bends the
/// scale of the map by offset / disparity. Several views of a landmark fix its distance up to one
/// common scale, so a line through (their inverse distance, measured disparity) of many landmarks
/// has the scale as its slope and the offset as its intercept. Done here as the maximum of the
/// profile likelihood: bundle adjustments of the whole map at offsets -h, 0, +h, the vertex of the
/// parabola through their costs, and where that is off zero the same again around it. Robust, and
/// with disparities of the
/// fine octaves alone: at depth edges patches mix two surfaces and lean to the nearer one, the more
/// the coarser they are. The noise level comes from the residuals.
DisparityOffset estimate_disparity_offset(const Map& map, const StereoCalibrationOptions& options,
                                          const std::atomic<bool>* stop = nullptr);

/// Decides when to look, and puts a significant offset into the map, which is then adjusted as a
/// whole. Looks twice, so the cost is bounded; the second look can take back what the first one
/// did.
class StereoCalibration {
 public:
  explicit StereoCalibration(const StereoCalibrationOptions& options)
      : options_(checked(options)) {}
  /// Returns whether the map was changed.
  bool update(Map& map, const std::atomic<bool>* stop = nullptr);

 private:
  StereoCalibrationOptions options_;
  int looks_ = 0;
};

}  // namespace kys_slam
