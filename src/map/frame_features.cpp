// SPDX-License-Identifier: BSD-3-Clause
#include "map/frame_features.h"

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
    : log_factor(static_cast<float>(std::log(scale_factor))) {
  double s = 1;
  for (int i = 0; i < levels; ++i, s *= scale_factor) scale.push_back(static_cast<float>(s));
}

std::vector<float> ScaleLevels::inv_sigmas() const {
  std::vector<float> all;
  for (const float sigma : {kPixelSigma, kAlignedSigma}) {
    for (int i = 0; i < levels(); ++i) all.push_back(inv_sigma(i, sigma));
  }
  return all;
}

int ScaleLevels::predict_octave(float max_distance, float distance) const {
  const float ratio = max_distance / distance;
  if (!(ratio > 1)) return 0;
  const float octave = std::ceil(std::log(ratio) / log_factor);
  return static_cast<int>(std::clamp(octave, 0.0f, static_cast<float>(levels() - 1)));
}

FrameFeatures::FrameFeatures(const StereoCamera& camera, FeatureSet left,
                             std::vector<float> u_right, std::vector<kys::Prior> priors,
                             float disparity_offset)
    : keypoints_(std::move(left.keypoints)),
      u_right_(std::move(u_right)),
      bf_(camera.bf()),
      disparity_offset_(disparity_offset) {
  const std::size_t n = size();
  if (left.descriptors.size() != n || u_right_.size() != n ||
      (!priors.empty() && priors.size() != n)) {
    throw std::logic_error("features of a frame differ in number");
  }
  descriptors_ = shared(std::move(left.descriptors));
  priors_ = shared(std::move(priors));
  if (n > kMostFeatures) throw std::logic_error("too many features in a frame");
  for (float& u : u_right_) u -= disparity_offset_;
  cell_width_inv_ = static_cast<float>(kColumns) / static_cast<float>(camera.width);
  cell_height_inv_ = static_cast<float>(kRows) / static_cast<float>(camera.height);
  fill_cells();
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
                                     std::vector<float> u_right, std::vector<kys::Prior> priors,
                                     std::vector<std::uint8_t> aligned, float disparity_offset) {
  FrameFeatures features(camera, std::move(left), std::move(u_right), std::move(priors));
  if (!aligned.empty() && aligned.size() != features.size()) {
    throw std::logic_error("features of a frame differ in number");
  }
  features.image_noise_ = !aligned.empty();
  features.aligned_ = std::move(aligned);
  features.disparity_offset_ = disparity_offset;
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
    Keypoint& k = changed.keypoints_.at(a.feature);
    changed.u_right_[a.feature] += a.u - k.x;
    k.x = a.u;
    k.y = a.v;
    changed.aligned_[a.feature] = 1;
  }
  changed.fill_cells();
  return changed;
}

FrameFeatures FrameFeatures::subset(std::span<const std::uint8_t> keep) const {
  if (keep.size() != size()) throw std::logic_error("a choice of features of another frame");
  FrameFeatures chosen;
  chosen.starts_per_row_ = 1;
  chosen.bf_ = bf_;
  chosen.disparity_offset_ = disparity_offset_;
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

FrameFeatures FrameFeatures::with_disparity_offset(float offset) const {
  FrameFeatures changed = *this;
  for (float& u : changed.u_right_) u -= offset - disparity_offset_;
  changed.disparity_offset_ = offset;
  return changed;
}

}  // namespace kys_slam
