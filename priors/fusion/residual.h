// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "priors/fusion/depth.h"
#include "priors/fusion/detection.h"
#include "priors/fusion/drift.h"
#include "priors/fusion/ego_motion.h"
#include "priors/fusion/options.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// Sums over the pixels of a segment, for its means.
struct SegmentSums {
  double depth = 0, residual = 0, radial = 0, radial_squared = 0, coverage = 0;
  std::uint32_t area = 0, depth_count = 0, flow_count = 0;
};

/// A row of observations.
struct ObservedRow {
  const float *disparity, *u, *v;  ///< px
  InverseDepth inverse_depth;
};

/// A row of corrected residuals and of the values summed with them; 0 where there is none.
struct CorrectedRow {
  float *residual, *has_residual;  ///< px, length; 1
  float* radial;                   ///< px, the part along the predicted flow
  float *depth, *has_depth;        ///< m; 1
  float* coverage;                 ///< 0..1
};

/// Images of the intermediate stages.
struct FusionImages {
  FlowField predicted, residual, drift;
  ImageOf<float> corrected;  ///< px, length of the corrected residual
};

/// Corrected residuals of Sec. 3.3: observed flow minus static flow minus drift. Makes two passes
/// over the rows and stores no images, because prediction costs less than storage. All arguments
/// must outlive it.
class ResidualField {
 public:
  ResidualField(const BuilderOptions::Drift& options, const EgoMotion& motion,
                const FlowField& flow, const ImageOf<float>& disparity,
                const InverseDepth& inverse_depth, const SegmentRuns& runs);

  /// Step 1: adds the residuals of the stuff pixels to the drift field.
  /// \param is_stuff by segment number.
  void add_to_drift(const std::vector<std::uint8_t>& is_stuff);
  /// Step 2.
  void smooth_drift() { drift_.smooth(); }
  /// Step 3, in any order with the functions below: adds every pixel to the sums of its segment.
  /// \return lengths of the corrected residuals of things, px, NaN where there is none; other
  /// pixels are uninitialised
  ImageOf<float> add_to_segments(const std::vector<std::uint8_t>& is_stuff,
                                 std::vector<SegmentSums>& sums);
  /// Median, median and 1.4826 MAD over every fourth stuff pixel of every fourth row.
  BackgroundReferences robust_references(const ImageOf<std::uint16_t>& map,
                                         const std::vector<std::uint8_t>& is_stuff);
  /// Medians of every thing segment; index as in `sums`. Segments below 16000 pixels are taken
  /// whole, larger ones on a regular grid of about 4000 to 16000 of their pixels.
  std::vector<MedianResidual> medians(const std::vector<std::uint8_t>& is_stuff,
                                      const std::vector<SegmentSums>& sums);
  FusionImages images();

 private:
  [[nodiscard]] ObservedRow observed(int y) const;
  /// Valid until the next call.
  CorrectedRow correct(int y);

  const EgoMotion& motion_;
  const FlowField& flow_;
  const ImageOf<float>& disparity_;
  InverseDepth inverse_depth_;
  const SegmentRuns& runs_;
  int width_, height_;
  DriftField drift_;
  std::array<std::vector<float>, 6> rows_;  ///< a CorrectedRow; longer by what lanes read behind it
};

}  // namespace kys_slam
