// SPDX-License-Identifier: BSD-3-Clause
#include "priors/fusion/residual.h"

#include <kys_slam/util/median.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "priors/fusion/flow_row.h"
#include "util/lanes.h"

namespace kys_slam {
namespace {

// By value: what is written could change anything that is referred to.
template <typename Flow>
KYS_ALWAYS_INLINE void add_residuals(Flow flow, ObservedRow observed, int x0, int x1,
                                     DriftField::Columns sums) {
  KYS_INDEPENDENT
  for (int x = x0; x < x1; ++x) {
    float u = 0, v = 0;
    flow.at(static_cast<float>(x), observed.inverse_depth(observed.disparity[x]), u, v);
    const float ru = observed.u[x] - u, rv = observed.v[x] - v;
    const bool valid = ru == ru;
    sums.u[x] += valid ? ru : 0.0F;
    sums.v[x] += valid ? rv : 0.0F;
    sums.count[x] += valid ? 1.0F : 0.0F;
  }
}

KYS_VECTOR_CLONES void add_residuals(const FlowRow& flow, const ObservedRow& observed, int x0,
                                     int x1, const DriftField::Columns& sums) {
  if (const auto* se3 = std::get_if<Se3FlowRow>(&flow)) {
    add_residuals(*se3, observed, x0, x1, sums);
  } else if (const auto* linear = std::get_if<LinearFlowRow>(&flow)) {
    add_residuals(*linear, observed, x0, x1, sums);
  }
}

template <typename Flow>
KYS_ALWAYS_INLINE void correct_residuals(Flow flow, ObservedRow observed, DriftField::Row drift,
                                         int width, CorrectedRow out) {
  KYS_INDEPENDENT
  for (int x = 0; x < width; ++x) {
    const float rho = observed.inverse_depth(observed.disparity[x]);
    float u = 0, v = 0, drift_u = 0, drift_v = 0;
    flow.at(static_cast<float>(x), rho, u, v);
    drift.at(x, drift_u, drift_v, out.coverage[x]);
    const float a = observed.u[x] - u - drift_u, b = observed.v[x] - v - drift_v;
    const float residual = std::sqrt(a * a + b * b);
    // Below 1e-3 px the flow has no direction.
    const float length = std::sqrt(u * u + v * v);
    const float along = (a * u + b * v) / (length + 1e-20F);
    const bool valid = residual == residual;
    out.residual[x] = valid ? residual : 0.0F;
    out.has_residual[x] = valid ? 1.0F : 0.0F;
    out.radial[x] = valid && length >= 1e-3F ? along : 0.0F;
    out.depth[x] = rho > 0 ? 1.0F / rho : 0.0F;
    out.has_depth[x] = rho > 0 ? 1.0F : 0.0F;
  }
}

KYS_VECTOR_CLONES void correct_residuals(const FlowRow& flow, const ObservedRow& observed,
                                         const DriftField::Row& drift, int width,
                                         const CorrectedRow& out) {
  if (const auto* se3 = std::get_if<Se3FlowRow>(&flow)) {
    correct_residuals(*se3, observed, drift, width, out);
  } else if (const auto* linear = std::get_if<LinearFlowRow>(&flow)) {
    correct_residuals(*linear, observed, drift, width, out);
  }
}

/// Sums of a row's quantities over x0 <= x < x1, in lanes: a single sum would wait for itself at
/// every pixel.
struct LaneSums {
  FloatLanes residual = {}, has_residual = {}, radial = {}, radial_squared = {}, depth = {},
             has_depth = {}, coverage = {};

  KYS_ALWAYS_INLINE void add(const CorrectedRow& row, int x, const FloatLanes& share) {
    const FloatLanes p = share * load_lanes(row.radial + x);
    residual += share * load_lanes(row.residual + x);
    has_residual += share * load_lanes(row.has_residual + x);
    radial += p;
    radial_squared += p * p;
    depth += share * load_lanes(row.depth + x);
    has_depth += share * load_lanes(row.has_depth + x);
    coverage += share * load_lanes(row.coverage + x);
  }

  KYS_ALWAYS_INLINE void add(const CorrectedRow& row, const SegmentRun& run) {
    // The lanes behind the end of a run have a share of zero.
    alignas(32) static constexpr float kShares[2 * kFloatLanes] = {1, 1, 1, 1, 1, 1, 1, 1};
    const FloatLanes whole = load_lanes(kShares);
    int x = run.x0;
    for (; x + kFloatLanes <= run.x1; x += kFloatLanes) add(row, x, whole);
    add(row, x, load_lanes(kShares + kFloatLanes - (run.x1 - x)));
  }
};

KYS_VECTOR_CLONES void add_runs(const CorrectedRow& row, std::span<const SegmentRun> runs,
                                SegmentSums* sums) {
  for (const SegmentRun& run : runs) {
    LaneSums lanes;
    lanes.add(row, run);
    SegmentSums& s = sums[run.segment];
    s.residual += lane_sum(lanes.residual);
    s.flow_count += static_cast<std::uint32_t>(lane_sum(lanes.has_residual));
    s.radial += lane_sum(lanes.radial);
    s.radial_squared += lane_sum(lanes.radial_squared);
    s.depth += lane_sum(lanes.depth);
    s.depth_count += static_cast<std::uint32_t>(lane_sum(lanes.has_depth));
    s.coverage += lane_sum(lanes.coverage);
  }
}

void copy_lengths(const CorrectedRow& row, int x0, int x1, float* out) {
  for (int x = x0; x < x1; ++x) out[x] = row.has_residual[x] > 0 ? row.residual[x] : kNoValue;
}

}  // namespace

ResidualField::ResidualField(const BuilderOptions::Drift& options, const EgoMotion& motion,
                             const FlowField& flow, const ImageOf<float>& disparity,
                             const InverseDepth& inverse_depth, const SegmentRuns& runs)
    : motion_(motion),
      flow_(flow),
      disparity_(disparity),
      inverse_depth_(inverse_depth),
      runs_(runs),
      width_(disparity.width()),
      height_(disparity.height()),
      drift_(options, width_, height_) {
  const auto length = static_cast<std::size_t>(width_ + kFloatLanes);
  for (std::vector<float>& row : rows_) row.resize(length);
}

void ResidualField::add_to_drift(const std::vector<std::uint8_t>& is_stuff) {
  for (int y = 0; y < height_; ++y) {
    if (!drift_.uses(y)) continue;
    const FlowRow flow = motion_.flow_row(y);
    const DriftField::Columns sums = drift_.columns(y);
    for (const SegmentRun& run : runs_.row(y)) {
      if (is_stuff[run.segment]) add_residuals(flow, observed(y), run.x0, run.x1, sums);
    }
  }
}

ObservedRow ResidualField::observed(int y) const {
  return {disparity_.row(y), flow_.u.row(y), flow_.v.row(y), inverse_depth_};
}

CorrectedRow ResidualField::correct(int y) {
  const CorrectedRow out = {rows_[0].data(), rows_[1].data(), rows_[2].data(),
                            rows_[3].data(), rows_[4].data(), rows_[5].data()};
  correct_residuals(motion_.flow_row(y), observed(y), drift_.row(y), width_, out);
  return out;
}

ImageOf<float> ResidualField::add_to_segments(const std::vector<std::uint8_t>& is_stuff,
                                              std::vector<SegmentSums>& sums) {
  auto lengths = ImageOf<float>::for_overwrite(width_, height_);
  for (int y = 0; y < height_; ++y) {
    const CorrectedRow row = correct(y);
    add_runs(row, runs_.row(y), sums.data());
    for (const SegmentRun& run : runs_.row(y)) {
      if (is_stuff[run.segment] || run.segment == 0) continue;
      copy_lengths(row, run.x0, run.x1, lengths.row(y));
    }
  }
  return lengths;
}

BackgroundReferences ResidualField::robust_references(const ImageOf<std::uint16_t>& map,
                                                      const std::vector<std::uint8_t>& is_stuff) {
  std::vector<float> lengths, radial;
  for (int y = 0; y < height_; y += 4) {
    const CorrectedRow row = correct(y);
    for (int x = (y / 4) % 4; x < width_; x += 4) {
      if (!is_stuff[map.at(x, y)] || row.has_residual[x] == 0) continue;
      lengths.push_back(row.residual[x]);
      radial.push_back(row.radial[x]);
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

std::vector<MedianResidual> ResidualField::medians(const std::vector<std::uint8_t>& is_stuff,
                                                   const std::vector<SegmentSums>& sums) {
  constexpr double kSamples = 4000;  // per segment, at a step that is not rounded
  struct Samples {
    int step = 1;  // px
    std::vector<float> u, v, length, parallax, disparity;
  };
  std::vector<Samples> samples(sums.size());
  for (std::size_t k = 1; k < sums.size(); ++k) {
    samples[k].step = std::max(1, static_cast<int>(std::sqrt(sums[k].area / kSamples)));
  }
  for (int y = 0; y < height_; ++y) {
    const FlowRow flow = motion_.flow_row(y);
    const DriftField::Row drift = drift_.row(y);
    const ObservedRow seen = observed(y);
    for (const SegmentRun& run : runs_.row(y)) {
      Samples& s = samples[run.segment];
      if (run.segment == 0 || is_stuff[run.segment] || y % s.step != 0) continue;
      for (int x = (run.x0 + s.step - 1) / s.step * s.step; x < run.x1; x += s.step) {
        const auto column = static_cast<float>(x);
        float u = 0, v = 0, far_u = 0, far_v = 0, drift_u = 0, drift_v = 0, coverage = 0;
        std::visit(
            [&](const auto& row) {
              row.at(column, inverse_depth_(seen.disparity[x]), u, v);
              row.at(column, 0.0F, far_u, far_v);
            },
            flow);
        drift.at(x, drift_u, drift_v, coverage);
        const float a = seen.u[x] - u - drift_u, b = seen.v[x] - v - drift_v;
        if (!(a == a && b == b)) continue;
        s.u.push_back(a);
        s.v.push_back(b);
        s.length.push_back(std::hypot(a, b));
        s.parallax.push_back(std::hypot(u - far_u, v - far_v));
        s.disparity.push_back(seen.disparity[x]);
      }
    }
  }
  std::vector<MedianResidual> medians(sums.size());
  for (std::size_t k = 1; k < sums.size(); ++k) {
    Samples& s = samples[k];
    if (s.u.empty()) continue;
    std::vector<float> us = s.u, vs = s.v;
    const float u = median(us), v = median(vs);
    for (std::size_t i = 0; i < s.u.size(); ++i) us[i] = std::hypot(s.u[i] - u, s.v[i] - v);
    medians[k] = {median(s.length), std::hypot(u, v), median(us), median(s.parallax),
                  median(s.disparity)};
  }
  return medians;
}

FusionImages ResidualField::images() {
  FusionImages images;
  for (FlowField* field : {&images.predicted, &images.residual, &images.drift}) {
    field->u = ImageOf<float>(width_, height_);
    field->v = ImageOf<float>(width_, height_);
  }
  images.corrected = ImageOf<float>(width_, height_);
  std::vector<float> inverse_depths(static_cast<std::size_t>(width_));
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) {
      inverse_depths[static_cast<std::size_t>(x)] = inverse_depth_(disparity_.at(x, y));
    }
    motion_.predict_row(y, inverse_depths.data(), images.predicted.u.row(y),
                        images.predicted.v.row(y));
    const DriftField::Row drift = drift_.row(y);
    copy_lengths(correct(y), 0, width_, images.corrected.row(y));
    for (int x = 0; x < width_; ++x) {
      images.residual.u.at(x, y) = flow_.u.at(x, y) - images.predicted.u.at(x, y);
      images.residual.v.at(x, y) = flow_.v.at(x, y) - images.predicted.v.at(x, y);
      float coverage = 0;
      drift.at(x, images.drift.u.at(x, y), images.drift.v.at(x, y), coverage);
    }
  }
  return images;
}

}  // namespace kys_slam
