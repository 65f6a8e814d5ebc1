#include "priors/builder/fuse.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>

#include "priors/builder/drift.h"
#include "priors/builder/vectorize.h"
#include "priors/format/prior_format.h"
#include "util/median.h"

namespace kys_slam {
namespace {

class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// Sums over a segment's pixels, before they become means.
struct Sums {
  double depth = 0, residual = 0, radial = 0, radial_squared = 0, coverage = 0;
  std::uint32_t area = 0, depth_count = 0, flow_count = 0;
};

/// Mean depth of every segment when there is no flow to go with it.
void add_depth(const SegmentRuns& runs, const ImageOf<float>& inverse_depth,
               std::vector<Sums>& sums) {
  for (int y = 0; y < inverse_depth.height(); ++y) {
    const float* rho = inverse_depth.row(y);
    const auto row = static_cast<std::size_t>(y);
    for (std::uint32_t i = runs.row_begin[row]; i < runs.row_begin[row + 1]; ++i) {
      const SegmentRun& run = runs.runs[i];
      Sums& s = sums[run.segment];
      for (int x = run.x0; x < run.x1; ++x) {
        if (!(rho[x] > 0)) continue;
        s.depth += 1.0F / rho[x];
        ++s.depth_count;
      }
    }
  }
}

/// The stages after the fit, row by row. Residuals are computed twice rather than stored: it is
/// cheaper than writing and reading four images.
class ResidualStage {
 public:
  ResidualStage(const BuilderOptions& options, const CameraPerception& in, const EgoMotion& motion,
                const SegmentRuns& runs, const std::vector<std::uint8_t>& is_stuff)
      : in_(in),
        motion_(motion),
        runs_(runs),
        is_stuff_(is_stuff),
        width_(in.inverse_depth.width()),
        height_(in.inverse_depth.height()),
        drift_(options.drift, width_, height_),
        corrected_(width_, height_) {
    for (std::vector<float>* row :
         {&fm_u_, &fm_v_, &r_u_, &r_v_, &d_u_, &d_v_, &cover_, &radial_, &depth_}) {
      row->resize(static_cast<std::size_t>(width_ + kPadding));
    }
    for (std::vector<float>& row : terms_) row.resize(static_cast<std::size_t>(width_ + kPadding));
  }

  void accumulate_drift() {
    for (int y = 0; y < height_; ++y) {
      residual_row(y);
      for_runs(y, [&](const SegmentRun& run) {
        if (is_stuff_[run.segment]) drift_.add(y, run.x0, run.x1, r_u_.data(), r_v_.data());
      });
    }
  }

  void smooth() { drift_.smooth(); }

  void measure(std::vector<Sums>& sums, FusionImages* images) {
    for (int y = 0; y < height_; ++y) {
      residual_row(y);
      drift_.row(y, d_u_.data(), d_v_.data(), cover_.data());
      if (images != nullptr) keep(y, *images);
      correct_row(y);
      add_row(y, sums);
    }
  }

  /// Lengths of the corrected residuals, px, NaN where there is none.
  ImageOf<float>& corrected() { return corrected_; }

  /// Part of the corrected residual along the predicted flow, row by row, for robust references.
  void radial_row(int y, std::vector<float>& out) {
    residual_row(y);
    drift_.row(y, d_u_.data(), d_v_.data(), cover_.data());
    correct_row(y);
    out = radial_;
  }

 private:
  template <typename Function>
  void for_runs(int y, Function&& function) const {
    // Not for_runs: its function would be compiled for the default processor alone.
    const auto row = static_cast<std::size_t>(y);
    for (std::uint32_t i = runs_.row_begin[row]; i < runs_.row_begin[row + 1]; ++i) {
      function(runs_.runs[i]);
    }
  }

  KYS_ROW_LOOP void residual_row(int y) {
    motion_.predict_row(y, in_.inverse_depth.row(y), fm_u_.data(), fm_v_.data());
    const float* __restrict u = in_.flow->u.row(y);
    const float* __restrict v = in_.flow->v.row(y);
    float* __restrict ru = r_u_.data();
    float* __restrict rv = r_v_.data();
    const float* __restrict fu = fm_u_.data();
    const float* __restrict fv = fm_v_.data();
    for (int x = 0; x < width_; ++x) {
      ru[x] = u[x] - fu[x];
      rv[x] = v[x] - fv[x];
    }
  }

  KYS_ROW_LOOP void correct_row(int y) {
    float* __restrict corrected = corrected_.row(y);
    float* __restrict radial = radial_.data();
    float* __restrict depth = depth_.data();
    const float* __restrict rho = in_.inverse_depth.row(y);
    const float* __restrict ru = r_u_.data();
    const float* __restrict rv = r_v_.data();
    const float* __restrict du = d_u_.data();
    const float* __restrict dv = d_v_.data();
    const float* __restrict fu = fm_u_.data();
    const float* __restrict fv = fm_v_.data();
    // The compiler does not test this many arrays for overlap: they do not.
#pragma GCC ivdep
    for (int x = 0; x < width_; ++x) {
      const float a = ru[x] - du[x], b = rv[x] - dv[x];
      const float flow = std::sqrt(fu[x] * fu[x] + fv[x] * fv[x]);
      corrected[x] = std::sqrt(a * a + b * b);
      // Below 1e-3 px the flow has no direction. NaN stays where there is no residual.
      const float direction = flow < 1e-3F ? 0.0F : 1.0F;
      radial[x] = direction * (a * fu[x] + b * fv[x]) / (flow + 1e-20F);
    }
    // What is summed over segments: values with 0 for "none", and counts.
    float* __restrict has_depth = terms_[0].data();
    float* __restrict residual = terms_[1].data();
    float* __restrict has_flow = terms_[2].data();
    float* __restrict along = terms_[3].data();
#pragma GCC ivdep
    for (int x = 0; x < width_; ++x) {
      has_depth[x] = rho[x] == rho[x] ? 1.0F : 0.0F;
      depth[x] = rho[x] == rho[x] ? 1.0F / rho[x] : 0.0F;
    }
#pragma GCC ivdep
    for (int x = 0; x < width_; ++x) {
      has_flow[x] = corrected[x] == corrected[x] ? 1.0F : 0.0F;
      residual[x] = corrected[x] == corrected[x] ? corrected[x] : 0.0F;
      along[x] = corrected[x] == corrected[x] ? radial[x] : 0.0F;
    }
  }

  /// Adds the row's pixels to the sums of their segments: eight partial sums of each quantity, all
  /// quantities in one go. A single sum would wait for itself at every pixel.
  KYS_ROW_LOOP void add_row(int y, std::vector<Sums>& sums) const {
    using Eight = float __attribute__((vector_size(32)));
    using Mask = std::int32_t __attribute__((vector_size(32)));
    constexpr Mask kLane = {0, 1, 2, 3, 4, 5, 6, 7};
    const float* const rows[6] = {depth_.data(),    terms_[0].data(), terms_[1].data(),
                                  terms_[2].data(), terms_[3].data(), cover_.data()};
    const auto row = static_cast<std::size_t>(y);
    for (std::uint32_t i = runs_.row_begin[row]; i < runs_.row_begin[row + 1]; ++i) {
      const SegmentRun& run = runs_.runs[i];
      Eight sum[7] = {};
      for (int x = run.x0; x < run.x1; x += 8) {
        // Rows are longer by kPadding; what is behind the run's end counts as 0.
        const Mask inside = kLane < Mask{} + (run.x1 - x);
        Eight value[6];
#pragma GCC unroll 6
        for (int k = 0; k < 6; ++k) {
          Mask bits;
          std::memcpy(&bits, rows[k] + x, sizeof bits);
          value[k] = reinterpret_cast<Eight>(bits & inside);
          sum[k] += value[k];
        }
        sum[6] += value[4] * value[4];
      }
      float total[7];
#pragma GCC unroll 7
      for (int k = 0; k < 7; ++k) {
        total[k] = ((sum[k][0] + sum[k][1]) + (sum[k][2] + sum[k][3])) +
                   ((sum[k][4] + sum[k][5]) + (sum[k][6] + sum[k][7]));
      }
      Sums& s = sums[run.segment];
      s.depth += total[0];
      s.depth_count += static_cast<std::uint32_t>(total[1]);
      s.residual += total[2];
      s.flow_count += static_cast<std::uint32_t>(total[3]);
      s.radial += total[4];
      s.coverage += total[5];
      s.radial_squared += total[6];
    }
  }

  void keep(int y, FusionImages& images) const {
    const auto copy = [y](const std::vector<float>& from, ImageOf<float>& to) {
      std::copy(from.begin(), from.begin() + to.width(), to.row(y));
    };
    copy(fm_u_, images.predicted.u);
    copy(fm_v_, images.predicted.v);
    copy(r_u_, images.residual.u);
    copy(r_v_, images.residual.v);
    copy(d_u_, images.drift.u);
    copy(d_v_, images.drift.v);
  }

  static constexpr int kPadding = 8;  // px

  const CameraPerception& in_;
  const EgoMotion& motion_;
  const SegmentRuns& runs_;
  const std::vector<std::uint8_t>& is_stuff_;
  int width_, height_;
  DriftField drift_;
  ImageOf<float> corrected_;
  std::array<std::vector<float>, 4> terms_;  ///< has depth, residual, has flow, radial
  std::vector<float> fm_u_, fm_v_, r_u_, r_v_, d_u_, d_v_, cover_, radial_, depth_;
};

SegmentStatistics to_means(const Sums& s) {
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

BackgroundReferences moments(const std::vector<Sums>& sums,
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

/// Median, median and 1.4826 MAD over every fourth stuff pixel of every fourth row.
BackgroundReferences robust(ResidualStage& stage, const ImageOf<std::uint16_t>& map,
                            const std::vector<std::uint8_t>& is_stuff) {
  std::vector<float> lengths, radial, row;
  for (int y = 0; y < map.height(); y += 4) {
    stage.radial_row(y, row);
    for (int x = (y / 4) % 4; x < map.width(); x += 4) {
      const float length = stage.corrected().at(x, y);
      if (!is_stuff[map.at(x, y)] || !(length == length)) continue;
      lengths.push_back(length);
      radial.push_back(row[static_cast<std::size_t>(x)]);
    }
  }
  BackgroundReferences bg;
  bg.pixels = static_cast<double>(lengths.size());
  if (lengths.empty()) return bg;
  bg.m_bg = median(lengths);
  bg.mu_par = median(radial);
  for (float& value : radial) value = std::abs(value - static_cast<float>(bg.mu_par));
  bg.sigma_par = 1.4826 * static_cast<double>(median(radial));
  return bg;
}

/// mu of the pixels of flagged segments: corrected residual over background, weighted.
void export_motion(const SegmentRuns& runs, CameraFusion& fusion, ImageOf<float>&& corrected) {
  std::vector<float> factor(fusion.decisions.size() + 1, 0.0F), mean(factor.size(), 0.0F);
  for (std::size_t k = 0; k < fusion.decisions.size(); ++k) {
    const MotionDecision& decision = fusion.decisions[k];
    if (!decision.dynamic) continue;
    const double weight = decision.radial_only ? 1.0 : decision.score / 100.0;
    factor[k + 1] = static_cast<float>(weight / fusion.background.m_bg);
    mean[k + 1] = static_cast<float>(fusion.statistics[k].residual);
  }
  for (int y = 0; y < corrected.height(); ++y) {
    float* row = corrected.row(y);
    const auto at = static_cast<std::size_t>(y);
    for (std::uint32_t i = runs.row_begin[at]; i < runs.row_begin[at + 1]; ++i) {
      const SegmentRun& run = runs.runs[i];
      const float f = factor[run.segment], fallback = mean[run.segment];
      if (f == 0.0F) continue;  // never read by the encoder
      for (int x = run.x0; x < run.x1; ++x) {
        const float length = row[x] == row[x] ? row[x] : fallback;
        row[x] = std::min(100.0F, length * f);
      }
    }
  }
  fusion.priors.motion = std::move(corrected);
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
    segment.flags = static_cast<std::uint16_t>(flags);
    segment.score = decision.dynamic ? static_cast<float>(decision.score) : 0.0F;
    fusion.priors.segments.push_back(segment);
  }
}

void resize(FusionImages& images, int width, int height) {
  for (FlowField* field : {&images.predicted, &images.residual, &images.drift}) {
    field->u = ImageOf<float>(width, height, kNoValue);
    field->v = ImageOf<float>(width, height, kNoValue);
  }
}

}  // namespace

CameraFusion fuse_camera(const BuilderOptions& options, const StereoCamera& camera,
                         const CameraPerception& in, FusionImages* images) {
  CameraFusion fusion;
  Stopwatch watch;
  const std::size_t count = in.panoptic.segments.size();
  const SegmentRuns runs = find_runs(in.panoptic.map);
  std::vector<Sums> sums(count + 1);
  for (const SegmentRun& run : runs.runs) sums[run.segment].area += run.x1 - run.x0;
  std::vector<std::uint8_t> is_stuff(count + 1, 0);
  for (std::size_t k = 0; k < count; ++k) is_stuff[k + 1] = !in.panoptic.segments[k].thing;
  fusion.times.runs = watch.lap();

  const bool has_flow = in.flow.has_value() && !in.inverse_depth.empty();
  if (has_flow) {
    fusion.ego_motion = fit_ego_motion(options.ego_motion, camera, *in.flow, in.inverse_depth,
                                       in.panoptic.map, is_stuff);
  }
  fusion.times.fit = watch.lap();
  ImageOf<float> corrected;
  if (fusion.ego_motion) {
    if (images != nullptr) resize(*images, in.panoptic.map.width(), in.panoptic.map.height());
    ResidualStage stage(options, in, *fusion.ego_motion, runs, is_stuff);
    stage.accumulate_drift();
    fusion.times.residual = watch.lap();
    stage.smooth();
    fusion.times.drift = watch.lap();
    stage.measure(sums, images);
    fusion.background = options.detection.references == References::kRobust
                            ? robust(stage, in.panoptic.map, is_stuff)
                            : moments(sums, is_stuff);
    const double floor = options.detection.reference_floor;
    fusion.background.m_bg = std::max(fusion.background.m_bg, floor);
    fusion.background.sigma_par = std::max(fusion.background.sigma_par, floor);
    corrected = std::move(stage.corrected());
    if (images != nullptr) images->corrected = corrected;
  } else if (!in.inverse_depth.empty()) {
    add_depth(runs, in.inverse_depth, sums);
  }
  fusion.times.statistics = watch.lap();

  bool any_dynamic = false;
  for (std::size_t k = 0; k < count; ++k) {
    fusion.statistics.push_back(to_means(sums[k + 1]));
    const bool decided = in.panoptic.segments[k].thing && fusion.ego_motion.has_value();
    fusion.decisions.push_back(decided ? decide(options, fusion.statistics[k], fusion.background)
                                       : MotionDecision{});
    any_dynamic |= fusion.decisions[k].dynamic;
  }
  if (any_dynamic) export_motion(runs, fusion, std::move(corrected));
  fill_segments(in, fusion);
  fusion.priors.segment_map = in.panoptic.map;
  fusion.times.decide_export = watch.lap();
  return fusion;
}

}  // namespace kys_slam
