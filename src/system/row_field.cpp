// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys/distance_model.h>
#include <kys_slam/error.h>
#include <kys_slam/row_field.h>
#include <kys_slam/util/median.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "features/orb_extractor.h"
#include "matching/row_alignment.h"
#include "matching/stereo_matcher.h"

namespace kys_slam {

namespace {

using Cells = std::array<std::array<RowField::Cell, RowField::kColumns>, RowField::kRows>;

std::size_t cell_of(double position, int size, std::size_t cells) {
  const double cell = position / size * static_cast<double>(cells);
  return std::min(static_cast<std::size_t>(std::max(cell, 0.0)), cells - 1);
}

double median_or_nan(std::vector<double>& values) {
  return values.size() < RowField::kLeastInCell ? std::nan("") : median(values);
}

Cells cells_of(const StereoCamera& camera, const std::vector<RowObservation>& matches,
               const RigCorrection& given, const RigCorrection& fitted) {
  struct Values {
    std::vector<double> before, after;
  };
  std::array<std::array<Values, RowField::kColumns>, RowField::kRows> values;
  for (const RowObservation& match : matches) {
    const RigCorrection::Measured& m = match.measured;
    Values& cell = values[cell_of(m.v, camera.height, RowField::kRows)]
                         [cell_of(m.u, camera.width, RowField::kColumns)];
    cell.before.push_back(given.pair(m).row);
    cell.after.push_back(fitted.pair(m).row);
  }
  Cells cells;
  for (std::size_t row = 0; row < RowField::kRows; ++row) {
    for (std::size_t column = 0; column < RowField::kColumns; ++column) {
      Values& v = values[row][column];
      cells[row][column] = {v.before.size(), median_or_nan(v.before), median_or_nan(v.after)};
    }
  }
  return cells;
}

double largest_of(const Cells& cells, double RowField::Cell::*value) {
  double largest = 0;
  for (const auto& row : cells) {
    for (const RowField::Cell& cell : row) {
      if (!std::isnan(cell.*value)) largest = std::max(largest, std::abs(cell.*value));
    }
  }
  return largest;
}

}  // namespace

RowVerdict RowField::verdict(double min_field) const {
  if (matches.size() < kLeastMatches) return RowVerdict::kUnknown;
  return fit.field > min_field ? RowVerdict::kUnrectified : RowVerdict::kRectified;
}

double RowField::largest() const {
  return largest_of(cells, &Cell::median);
}

double RowField::largest_after() const {
  return largest_of(cells, &Cell::median_after);
}

std::string RowField::describe(double min_field) const {
  switch (verdict(min_field)) {
    case RowVerdict::kRectified:
      return fmt::format("rectified (rows agree to {:.2f} px rms, at worst {:.2f} px)", fit.field,
                         largest());
    case RowVerdict::kUnrectified:
      return fmt::format(
          "not rectified: rows differ by up to {:.2f} px; a run corrects this to {:.2f} px",
          largest(), largest_after());
    case RowVerdict::kUnknown:
      break;
  }
  return fmt::format("too few matches to tell: {} with a measured row, {} are needed",
                     matches.size(), kLeastMatches);
}

struct RowMeter::Impl {
  Impl(const StereoCamera& camera_in, const RigEstimate& known_in)
      : camera(camera_in),
        known{RigCorrection(camera_in, known_in.correction.parameters()), known_in.covariance} {}

  [[nodiscard]] StereoView view(std::size_t side) const {
    return {&features[side], {}, &extractors[side].pyramid()};
  }

  StereoCamera camera;
  RigEstimate known;
  ScaleLevels scales{OrbOptions().scale_factor, OrbOptions().levels};
  std::array<OrbExtractor, 2> extractors{OrbExtractor(OrbOptions()), OrbExtractor(OrbOptions())};
  std::array<FeatureSet, 2> features;  // left, right, of the last pair
  kys::DistanceModel model;
  RowField measured;  // without cells and fit
};

RowMeter::RowMeter(const StereoCamera& camera, const RigEstimate& known)
    : impl_(new Impl(camera, known)) {}
RowMeter::RowMeter(RowMeter&&) noexcept = default;
RowMeter& RowMeter::operator=(RowMeter&&) noexcept = default;
RowMeter::~RowMeter() = default;

void RowMeter::add(const GrayImage& left, const GrayImage& right) {
  Impl& s = *impl_;
  for (const GrayImage* image : {&left, &right}) {
    if (image->width() == s.camera.width && image->height() == s.camera.height) continue;
    throw InputError(fmt::format("the {} image is {}x{} px, the camera {}x{}",
                                 image == &left ? "left" : "right", image->width(), image->height(),
                                 s.camera.width, s.camera.height));
  }
  s.extractors[0].extract(left, s.features[0]);
  s.extractors[1].extract(right, s.features[1]);
  kys::Statistics statistics;
  const std::vector<float> u_right =
      match_stereo(s.camera, s.scales, s.view(0), s.view(1), StereoOptions(), s.model, statistics,
                   nullptr, s.known.correction)
          .u;
  const std::vector<float> v_right =
      measure_rows(s.view(0), s.view(1), u_right, s.known.correction, u_right.size() + 1);
  ++s.measured.pairs;
  for (std::size_t i = 0; i < u_right.size(); ++i) {
    if (std::isnan(u_right[i])) continue;
    ++s.measured.stereo_matches;
    if (std::isnan(v_right[i])) continue;
    const Keypoint& k = s.features[0].keypoints[i];
    s.measured.matches.push_back({{k.x, k.y, u_right[i], v_right[i]}, s.scales.scale[k.octave]});
  }
}

RowField RowMeter::field() const {
  RowField field = impl_->measured;
  field.fit = fit_rows(impl_->camera, field.matches, impl_->known);
  field.cells =
      cells_of(impl_->camera, field.matches, impl_->known.correction, field.fit.rig.correction);
  return field;
}

}  // namespace kys_slam
