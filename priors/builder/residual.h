#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "priors/builder/depth.h"
#include "priors/builder/detection.h"
#include "priors/builder/drift.h"
#include "priors/builder/ego_motion.h"
#include "priors/builder/options.h"
#include "priors/builder/panoptic.h"

namespace kys_slam {

/// Sums over a segment's pixels, before they become means.
struct SegmentSums {
  double depth = 0, residual = 0, radial = 0, radial_squared = 0, coverage = 0;
  std::uint32_t area = 0, depth_count = 0, flow_count = 0;
};

/// A row of what was observed.
struct ObservedRow {
  const float *disparity, *u, *v;  ///< px
  InverseDepth inverse_depth;
};

/// A row of corrected residuals and what is summed beside them: 0 where there is none.
struct CorrectedRow {
  float *residual, *has_residual;  ///< px, length; 1
  float* radial;                   ///< px, the part along the predicted flow
  float *depth, *has_depth;        ///< m; 1
  float* coverage;                 ///< 0..1
};

/// Images of the intermediate stages, for pictures.
struct FusionImages {
  FlowField predicted, residual, drift;
  ImageOf<float> corrected;  ///< px, length of the corrected residual
};

/// Sec. 3.3 between the fit and the decision: the observed flow less the static one, less its own
/// drift. Goes over the rows twice and keeps no image: to predict again costs less than to store.
/// Everything given must outlive it.
class ResidualField {
 public:
  ResidualField(const BuilderOptions::Drift& options, const EgoMotion& motion,
                const FlowField& flow, const ImageOf<float>& disparity,
                const InverseDepth& inverse_depth, const SegmentRuns& runs);

  /// First: the residuals of the stuff pixels. \param is_stuff by segment number.
  void add_to_drift(const std::vector<std::uint8_t>& is_stuff);
  /// Second.
  void smooth_drift() { drift_.smooth(); }
  /// Third, and after this in any order: adds every pixel to the sums of its segment.
  /// \return lengths of the corrected residuals of things, px, NaN where there is none; what is not
  /// part of a thing has no value.
  ImageOf<float> add_to_segments(const std::vector<std::uint8_t>& is_stuff,
                                 std::vector<SegmentSums>& sums);
  /// Median, median and 1.4826 MAD over every fourth stuff pixel of every fourth row.
  BackgroundReferences robust_references(const ImageOf<std::uint16_t>& map,
                                         const std::vector<std::uint8_t>& is_stuff);
  /// Of every thing segment, over a regular grid of its pixels; index as `area`.
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
