// SPDX-License-Identifier: BSD-3-Clause
#include "map/frame_features.h"

#include <kys/portable_math.h>

#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>

namespace kys_slam {

namespace {

/// A list that several owners keep, as its first element; null when it is empty.
template <typename T>
std::shared_ptr<const T> shared(std::vector<T> list) {
  if (list.empty()) return nullptr;
  const auto owner = std::make_shared<const std::vector<T>>(std::move(list));
  return {owner, owner->data()};
}

}  // namespace

ScaleLevels::ScaleLevels(double scale_factor, int levels)
    : log_factor(static_cast<float>(kys::portable::log(scale_factor))) {
  double s = 1;
  for (int i = 0; i < levels; ++i, s *= scale_factor) scale.push_back(static_cast<float>(s));
}

ScaleLevels::ScaleLevels(const ExtractorTraits& traits)
    : ScaleLevels(traits.scale_factor, traits.levels) {
  sizes = traits.sizes;
  reach = static_cast<float>(traits.reach);
  pixel_sigma = static_cast<float>(traits.pixel_sigma);
  extractor = traits.name;
  distances = traits.distances;
}

std::vector<float> ScaleLevels::inv_sigmas() const {
  std::vector<float> all;
  for (const float sigma : {pixel_sigma, kAlignedSigma}) {
    for (int i = 0; i < levels(); ++i) all.push_back(inv_sigma(i, sigma));
  }
  return all;
}

int ScaleLevels::predict_octave(float max_distance, float distance) const {
  const float ratio = max_distance / (reach * distance);
  if (!sizes || !(ratio > 1)) return 0;
  const float octave = std::ceil(kys::portable::log(ratio) / log_factor);
  return static_cast<int>(std::clamp(octave, 0.0f, static_cast<float>(levels() - 1)));
}

FrameFeatures::FrameFeatures(const StereoCamera& camera, FeatureSet left, RightPositions right,
                             std::vector<kys::Prior> priors, const RigCorrection& rig)
    : keypoints_(std::move(left.keypoints)),
      u_right_(std::move(right.u)),
      rig_(rig),
      bf_(camera.bf()) {
  const std::size_t n = size();
  if (left.descriptors.size() != n || u_right_.size() != n ||
      (!right.v.empty() && right.v.size() != n) || (!priors.empty() && priors.size() != n)) {
    throw std::logic_error("features of a frame differ in number");
  }
  descriptors_ = shared(std::move(left.descriptors));
  priors_ = shared(std::move(priors));
  if (n > kMostFeatures) throw std::logic_error("too many features in a frame");
  cell_width_inv_ = static_cast<float>(kColumns) / static_cast<float>(camera.width);
  cell_height_inv_ = static_cast<float>(kRows) / static_cast<float>(camera.height);
  if (!rig.none() || !right.v.empty()) {
    measured_.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
      const Keypoint& k = keypoints_[i];
      measured_.push_back({k.x, k.y, u_right_[i], right.v.empty() ? std::nanf("") : right.v[i]});
    }
  }
  for (std::size_t i = 0; i < measured_.size(); ++i) correct(i);
  fill_cells();
}

/// Sets the position of a feature by what was measured.
void FrameFeatures::correct(std::size_t i) {
  const RigCorrection::Measured& m = measured_[i];
  Keypoint& k = keypoints_[i];
  k.x = m.u;
  k.y = m.v;
  u_right_[i] = m.u_right;
  if (!rig_.bends()) {
    u_right_[i] -= static_cast<float>(rig_.offset());
  } else if (std::isnan(m.u_right)) {
    const Eigen::Vector2d left = rig_.left(m.u, m.v);
    k.x = static_cast<float>(left.x());
    k.y = static_cast<float>(left.y());
  } else {
    const RigCorrection::Ideal ideal = rig_.pair(m);
    k.x = static_cast<float>(ideal.u);
    k.y = static_cast<float>(ideal.v);
    u_right_[i] = static_cast<float>(ideal.u_right);
  }
}

/// Groups the features by cells.
void FrameFeatures::fill_cells() {
  const std::size_t n = size();
  std::vector<std::uint16_t> cell(n);
  cell_start_.assign(kRows * kColumns + 1, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const Keypoint& k = keypoints_[i];
    const int c = column_of(k);
    const int r = std::clamp(static_cast<int>(k.y * cell_height_inv_), 0, kRows - 1);
    cell[i] = static_cast<std::uint16_t>(r * kColumns + c);
    ++cell_start_[cell[i] + 1u];
  }
  for (std::size_t c = 1; c < cell_start_.size(); ++c) {
    cell_start_[c] = static_cast<std::uint16_t>(cell_start_[c] + cell_start_[c - 1]);
  }
  cell_feature_.resize(n);
  std::vector<std::uint16_t> next(cell_start_.begin(), cell_start_.end() - 1);
  for (std::size_t i = 0; i < n; ++i)
    cell_feature_[next[cell[i]]++] = static_cast<std::uint16_t>(i);
  if (starts_per_row_ == kColumns) return;
  std::vector<std::uint16_t> row_start;
  row_start.reserve(kRows + 1);
  for (std::size_t r = 0; r <= kRows; ++r) row_start.push_back(cell_start_[r * kColumns]);
  cell_start_ = std::move(row_start);
}

FrameFeatures FrameFeatures::restore(const StereoCamera& camera, FeatureSet left,
                                     RightPositions right, std::vector<kys::Prior> priors,
                                     std::vector<std::uint8_t> aligned, const RigCorrection& rig) {
  FrameFeatures features(camera, std::move(left), std::move(right), std::move(priors), rig);
  if (!aligned.empty() && aligned.size() != features.size()) {
    throw std::logic_error("features of a frame differ in number");
  }
  features.image_noise_ = !aligned.empty();
  features.aligned_ = std::move(aligned);
  return features;
}

FrameFeatures FrameFeatures::with_image_noise() const {
  FrameFeatures changed = *this;
  changed.image_noise_ = true;
  return changed;
}

FrameFeatures FrameFeatures::with_aligned(std::span<const Aligned> aligned) const {
  FrameFeatures changed = with_image_noise();
  changed.aligned_.resize(size(), 0);
  for (const Aligned& a : aligned) {
    changed.aligned_[a.feature] = 1;
    if (!measured_.empty()) {
      RigCorrection::Measured& m = changed.measured_.at(a.feature);
      m.u_right += a.u - m.u;
      m.v_right += a.v - m.v;
      m.u = a.u;
      m.v = a.v;
      changed.correct(a.feature);
      continue;
    }
    Keypoint& k = changed.keypoints_.at(a.feature);
    changed.u_right_[a.feature] += a.u - k.x;
    k.x = a.u;
    k.y = a.v;
  }
  changed.fill_cells();
  return changed;
}

FrameFeatures FrameFeatures::subset(std::span<const std::uint8_t> keep) const {
  if (keep.size() != size()) throw std::logic_error("a choice of features of another frame");
  FrameFeatures chosen;
  chosen.starts_per_row_ = 1;
  chosen.bf_ = bf_;
  chosen.rig_ = rig_;
  chosen.image_noise_ = image_noise_;
  chosen.cell_width_inv_ = cell_width_inv_;
  chosen.cell_height_inv_ = cell_height_inv_;
  const auto count =
      static_cast<std::size_t>(std::count_if(keep.begin(), keep.end(), std::identity{}));
  const auto pick = [&]<typename T>(std::span<const T> from) {
    std::vector<T> to;
    if (from.empty()) return to;  // no priors, none aligned
    to.reserve(count);
    for (std::size_t i = 0; i < keep.size(); ++i) {
      if (keep[i] != 0) to.push_back(from[i]);
    }
    return to;
  };
  chosen.keypoints_ = pick(keypoints());
  chosen.descriptors_ = shared(pick(descriptors()));
  chosen.priors_ = shared(pick(priors()));
  chosen.u_right_ = pick(std::span<const float>(u_right_));
  chosen.measured_ = pick(std::span<const RigCorrection::Measured>(measured_));
  chosen.aligned_ = pick(aligned());
  chosen.fill_cells();
  return chosen;
}

FrameFeatures FrameFeatures::with_priors(std::vector<kys::Prior> priors) const {
  if (!priors.empty() && priors.size() != size()) {
    throw std::logic_error("features of a frame differ in number");
  }
  FrameFeatures changed = *this;
  changed.priors_ = shared(std::move(priors));
  return changed;
}

bool FrameFeatures::measures_rows() const {
  return std::any_of(measured_.begin(), measured_.end(),
                     [](const RigCorrection::Measured& m) { return !std::isnan(m.v_right); });
}

FrameFeatures FrameFeatures::with_rig(const RigCorrection& rig) const {
  FrameFeatures changed = *this;
  changed.rig_ = rig;
  if (measured_.empty()) {
    changed.measured_.reserve(size());
    for (std::size_t i = 0; i < size(); ++i) changed.measured_.push_back(measured(i));
  }
  for (std::size_t i = 0; i < size(); ++i) changed.correct(i);
  changed.fill_cells();
  return changed;
}

}  // namespace kys_slam
