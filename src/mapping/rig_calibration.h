// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/option_list.h>
#include <kys_slam/check_options.h>
#include <kys_slam/rig_rows.h>

#include <atomic>
#include <cstddef>
#include <optional>

#include "map/map.h"

namespace kys_slam {

struct RigCalibrationOptions {
  bool enabled = true;
  int keyframes = 20;         ///< in the map at the first estimate
  double significance = 2.5;  ///< standard deviations by which an offset alone must differ
  /// px, standard deviation of an estimate of the offset alone in addition to that from noise, in a
  /// map of `keyframes` keyframes: patches that contain two surfaces have biased disparities. The
  /// first estimates on 30 rendered sequences with zero true offset have a root mean square of
  /// 0.022 px. The worst is 0.053 px (`hall` at 376x240 px), which this rejects. Errors of more
  /// places cancel: it falls with the square root of the number of keyframes, down to 0.7 times.
  double systematic = 0.026;
  double max_correction = 1;  ///< px; a larger offset is a failure and is not applied
  int min_observers = 3;      ///< keyframes that observe a landmark used here
};
/// For check_options().
void describe(kys::OptionList& list, RigCalibrationOptions& options);

/// Estimates the correction of the rig from a map: of all parameters when the rows have shown that
/// the pair is not rectified (FrontEnd), else of the constant offset of disparities alone. Several
/// views of a landmark determine its distance up to one common scale, so that a line through
/// (inverse distance, disparity) of many landmarks has the scale as its slope and the offset as its
/// intercept; the other parameters show in how both depend on the place in the images. The
/// estimate is that of a bundle adjustment with these parameters (rig_bundle.h), of at most the
/// newest 80 keyframes. Disparities of fine octaves count only: at depth edges patches contain two
/// surfaces, with a bias to the nearer one that grows with the octave.
/// \param prior of all parameters \return nothing without enough to see, or when stopped
std::optional<RigEstimate> estimate_rig(const Map& map, const RigCalibrationOptions& options,
                                        const RigEstimate& prior,
                                        const std::atomic<bool>* stop = nullptr);

/// Decides when to estimate, applies the estimate to the map, and adjusts the whole map then. It
/// estimates when the map has 1, 2 and 8 times `keyframes`, which bounds the cost. The first
/// keyframes are close together: a later estimate can refine or revert an earlier one. A run that
/// ends before the third estimate has one more at its end.
class RigCalibration {
 public:
  explicit RigCalibration(const RigCalibrationOptions& options) : options_(checked(options)) {}
  /// The correction before anything is seen, and what it is worth, in place of none.
  void start_rig(const RigEstimate& rig) { prior_ = rig; }
  /// Returns whether the map was changed.
  /// \param seen keyframes so far, with those that left the map for their age
  bool update(Map& map, std::size_t seen, const std::atomic<bool>* stop = nullptr);
  /// At the end of a run: one more estimate, unless the third was made or the map has hardly grown
  /// since the one before. What was not significant in a few keyframes may be now. Returns whether
  /// the map was changed.
  bool finish(Map& map, std::size_t seen, const std::atomic<bool>* stop = nullptr);
  /// The latest estimate of the offset alone, applied or not.
  [[nodiscard]] const std::optional<OffsetEstimate>& offset() const { return offset_; }

 private:
  bool estimate(Map& map, std::size_t keyframes, bool last, const std::atomic<bool>* stop);
  [[nodiscard]] bool is_worth(const Map& map, RigEstimate& found, bool last);

  RigCalibrationOptions options_;
  RigEstimate prior_{{}, rig_prior()};
  std::size_t estimates_made_ = 0;
  std::size_t seen_ = 0;  ///< keyframes at the latest estimate
  std::optional<OffsetEstimate> offset_;
};

}  // namespace kys_slam
