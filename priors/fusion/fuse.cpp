// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/fuse.h"

#include <kys_slam/prior_format.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <cmath>

#include "priors/fusion/appearance.h"

namespace kys_slam {
namespace {

/// Mean depth of every segment when there is no flow to go with it.
void add_depth(const SegmentRuns& runs, const ImageOf<float>& disparity,
               const InverseDepth& inverse_depth, std::vector<SegmentSums>& sums) {
  for (int y = 0; y < disparity.height(); ++y) {
    for (const SegmentRun& run : runs.row(y)) {
      SegmentSums& s = sums[run.segment];
      for (int x = run.x0; x < run.x1; ++x) {
        const float rho = inverse_depth(disparity.at(x, y));
        if (!(rho > 0)) continue;
        s.depth += 1.0F / rho;
        ++s.depth_count;
      }
    }
  }
}

SegmentStatistics to_means(const SegmentSums& s) {
  SegmentStatistics m;
  m.area = s.area;
  m.depth_count = s.depth_count;
  m.flow_count = s.flow_count;
  if (s.depth_count > 0) m.mean_depth = s.depth / s.depth_count;
  if (s.area > 0) m.coverage = s.coverage / s.area;
  if (s.flow_count > 0) {
    m.residual = s.residual / s.flow_count;
    m.radial = s.radial / s.flow_count;
  }
  return m;
}

BackgroundReferences moments(const std::vector<SegmentSums>& sums,
                             const std::vector<std::uint8_t>& is_stuff) {
  double n = 0, residual = 0, radial = 0, squared = 0;
  for (std::size_t k = 0; k < sums.size(); ++k) {
    if (!is_stuff[k]) continue;
    n += sums[k].flow_count;
    residual += sums[k].residual;
    radial += sums[k].radial;
    squared += sums[k].radial_squared;
  }
  BackgroundReferences bg;
  bg.pixels = n;
  if (n == 0) return bg;
  bg.m_bg = residual / n;
  bg.mu_par = radial / n;
  bg.sigma_par = std::sqrt(std::max(0.0, squared / n - bg.mu_par * bg.mu_par));
  return bg;
}

/// mu of the pixels of flagged segments: corrected residual over background, weighted.
/// \param lengths px, of the corrected residuals; becomes mu.
void export_motion(const SegmentRuns& runs, ImageOf<float> lengths, CameraFusion& fusion) {
  std::vector<float> factor(fusion.decisions.size() + 1, 0.0F), mean(factor.size(), 0.0F);
  bool any = false;
  for (std::size_t k = 0; k < fusion.decisions.size(); ++k) {
    const MotionDecision& decision = fusion.decisions[k];
    if (!decision.dynamic) continue;
    any = true;
    const double weight = decision.radial_only ? 1.0 : decision.score / 100.0;
    factor[k + 1] = static_cast<float>(weight / fusion.background.m_bg);
    mean[k + 1] = static_cast<float>(fusion.statistics[k].residual);
  }
  if (!any) return;
  for (int y = 0; y < lengths.height(); ++y) {
    float* row = lengths.row(y);
    for (const SegmentRun& run : runs.row(y)) {
      if (run.segment == 0 || !fusion.decisions[run.segment - 1u].dynamic) continue;
      const float f = factor[run.segment], fallback = mean[run.segment];
      for (int x = run.x0; x < run.x1; ++x) {
        row[x] = std::min(100.0F, f * (row[x] == row[x] ? row[x] : fallback));
      }
    }
  }
  fusion.priors.motion = std::move(lengths);
}

/// mu of flagged segments where the whole segment is decided by its belief: 100 times the
/// probability that it moves.
void export_belief(const SegmentRuns& runs, int width, int height, CameraFusion& fusion) {
  const auto dynamic = [](const MotionDecision& decision) { return decision.dynamic; };
  if (std::none_of(fusion.decisions.begin(), fusion.decisions.end(), dynamic)) return;
  fusion.priors.motion = ImageOf<float>(width, height);
  for (int y = 0; y < height; ++y) {
    for (const SegmentRun& run : runs.row(y)) {
      if (run.segment == 0 || !fusion.decisions[run.segment - 1u].dynamic) continue;
      const auto mu = static_cast<float>(fusion.decisions[run.segment - 1u].score);
      std::fill(fusion.priors.motion.row(y) + run.x0, fusion.priors.motion.row(y) + run.x1, mu);
    }
  }
}

void fill_segments(const CameraPerception& in, CameraFusion& fusion) {
  for (std::size_t k = 0; k < in.panoptic.segments.size(); ++k) {
    const InputSegment& input = in.panoptic.segments[k];
    const MotionDecision& decision = fusion.decisions[k];
    PriorSegment segment;
    segment.label = input.label;
    segment.instance = in.instances[k];
    segment.area = fusion.statistics[k].area;
    segment.scale = depth_compensated_scale(fusion.statistics[k]);
    int flags = input.thing ? prior_format::kThing : 0;
    if (decision.dynamic) flags |= prior_format::kDynamic;
    if (decision.radial_only) flags |= prior_format::kRadialOnly;
    if (input.thing && !decision.judged && !decision.dynamic) flags |= prior_format::kNotJudged;
    segment.flags = static_cast<std::uint16_t>(flags);
    segment.score = decision.dynamic ? static_cast<float>(decision.score) : 0.0F;
    fusion.priors.segments.push_back(segment);
  }
}

}  // namespace

MeasuredCamera measure_camera(const BuilderOptions& options, const StereoCamera& camera,
                              CameraPerception in, FusionImages* images) {
  MeasuredCamera measured;
  CameraFusion& fusion = measured.fusion;
  Stopwatch watch;
  const std::size_t count = in.panoptic.segments.size();
  if (in.panoptic.runs.empty()) in.panoptic.runs = find_runs(in.panoptic.map);
  const SegmentRuns& runs = in.panoptic.runs;
  std::vector<SegmentSums> sums(count + 1);
  for (const SegmentRun& run : runs.runs) sums[run.segment].area += run.x1 - run.x0;
  const std::vector<std::uint8_t> is_stuff = stuff_mask(in.panoptic);
  const InverseDepth inverse_depth(camera.bf(), options.depth.max_depth);
  if (in.flow && !in.disparity.empty()) {
    fusion.ego_motion = fit_ego_motion(options.ego_motion, camera, *in.flow, in.disparity,
                                       inverse_depth, in.panoptic.map, is_stuff);
  }
  fusion.times.fit = watch.lap_ms();
  std::vector<MedianResidual> medians(count + 1);
  std::vector<AppearanceEvidence> appearance(count + 1);
  if (fusion.ego_motion) {
    ResidualField residuals(options.drift, *fusion.ego_motion, *in.flow, in.disparity,
                            inverse_depth, runs);
    residuals.add_to_drift(is_stuff);
    fusion.times.residual = watch.lap_ms();
    residuals.smooth_drift();
    fusion.times.drift = watch.lap_ms();
    const bool robust = options.detection.method == DetectionMethod::kRobust;
    measured.lengths = residuals.add_to_segments(is_stuff, sums);
    fusion.background = robust || options.detection.references == References::kRobust
                            ? residuals.robust_references(in.panoptic.map, is_stuff)
                            : moments(sums, is_stuff);
    if (robust) medians = residuals.medians(is_stuff, sums);
    if (robust && in.now != nullptr && in.next != nullptr) {
      appearance = compare_appearance(*in.now, *in.next, *fusion.ego_motion, *in.flow, in.disparity,
                                      inverse_depth, runs, is_stuff);
    }
    const double floor = options.detection.reference_floor;
    fusion.background.m_bg = std::max(fusion.background.m_bg, floor);
    fusion.background.sigma_par = std::max(fusion.background.sigma_par, floor);
    if (images != nullptr) *images = residuals.images();
  } else if (!in.disparity.empty()) {
    add_depth(runs, in.disparity, inverse_depth, sums);
  }
  for (std::size_t k = 0; k < count; ++k) {
    fusion.statistics.push_back(to_means(sums[k + 1]));
    fusion.statistics[k].median = medians[k + 1];
    fusion.statistics[k].appearance = appearance[k + 1];
  }
  fusion.decisions.resize(count);
  fusion.segments = in.panoptic.segments;
  fusion.times.statistics = watch.lap_ms();
  measured.input = std::move(in);
  return measured;
}

void decide_segments(const BuilderOptions& options, CameraFusion& fusion) {
  if (!fusion.ego_motion) return;
  for (std::size_t k = 0; k < fusion.segments.size(); ++k) {
    if (!fusion.segments[k].thing) continue;
    fusion.decisions[k] = decide(options, fusion.statistics[k], fusion.background);
  }
}

CameraFusion export_camera(const BuilderOptions& options, MeasuredCamera measured) {
  CameraFusion fusion = std::move(measured.fusion);
  Stopwatch watch;
  fill_segments(measured.input, fusion);
  PanopticMap& panoptic = measured.input.panoptic;
  if (options.detection.method == DetectionMethod::kRobust) {
    export_belief(panoptic.runs, panoptic.map.width(), panoptic.map.height(), fusion);
  } else if (fusion.ego_motion) {
    export_motion(panoptic.runs, std::move(measured.lengths), fusion);
  }
  fusion.priors.segment_map = std::move(panoptic.map);
  fusion.priors.runs = std::move(panoptic.runs);
  fusion.times.decide_export = watch.lap_ms();
  return fusion;
}

CameraFusion fuse_camera(const BuilderOptions& options, const StereoCamera& camera,
                         CameraPerception in, FusionImages* images) {
  MeasuredCamera measured = measure_camera(options, camera, std::move(in), images);
  decide_segments(options, measured.fusion);
  return export_camera(options, std::move(measured));
}

}  // namespace kys_slam
