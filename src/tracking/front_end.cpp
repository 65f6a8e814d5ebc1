// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/front_end.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/util/stopwatch.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <string>

#include "matching/row_alignment.h"

namespace kys_slam {

namespace {

constexpr std::size_t kRowsFirst = 600;  // measured, in the frame that decides
constexpr std::size_t kRowsLater = 200;
constexpr std::size_t kLeastRows = 100;  // to decide

/// Removes the features for which keep(index) is false; returns how many. `priors`: one per feature
/// or none.
template <typename Keep>
int drop_features(FeatureSet& features, std::vector<kys::Prior>& priors, Keep&& keep) {
  std::size_t n = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (!keep(i)) continue;
    features.keypoints[n] = features.keypoints[i];
    features.descriptors[n] = features.descriptors[i];
    if (!priors.empty()) priors[n] = priors[i];
    ++n;
  }
  const auto dropped = static_cast<int>(features.size() - n);
  features.keypoints.resize(n);
  features.descriptors.resize(n);
  if (!priors.empty()) priors.resize(n);
  return dropped;
}

/// Raises the instance numbers of things.
void raise(std::vector<kys::Prior>& priors, std::int32_t by, std::span<const std::uint8_t> thing,
           const StereoFrame& frame) {
  for (kys::Prior& prior : priors) {
    if (prior.label >= thing.size() || thing[prior.label] == 0 || prior.instance < 0) continue;
    if (prior.instance % kys::kRightInstances >= kys::kRightInstances - by) {
      const std::string name = frame.name.empty() ? std::to_string(frame.index) : frame.name;
      throw InputError("frame " + name + ": instance " + std::to_string(prior.instance) +
                       " is too high beside those of the loaded map");
    }
    prior.instance += by;
  }
}

/// Whether the keypoint's nearest pixel (as prior files are read) is masked.
bool is_masked(const GrayImage& mask, const Keypoint& keypoint) {
  const auto x = static_cast<int>(std::floor(keypoint.x + 0.5F));
  const auto y = static_cast<int>(std::floor(keypoint.y + 0.5F));
  return mask.contains(x, y) && mask.at(x, y) != 0;
}

}  // namespace

void describe(kys::OptionList& list, RowOptions& o) {
  list.add("calibration.rows", o.enabled, "correct rows that differ between the images");
  list.add("calibration.min_field", o.min_field, {0, 100}, "px",
           "rows that differ by less (root mean square over the image) are taken for equal");
  const kys::OptionList::Fixed fixed(list);
  list.add("calibration.row_frames", o.frames, {1, 1e9});
}

FrontEnd::FrontEnd(const StereoCamera& camera, std::unique_ptr<FeatureExtractor> extractor,
                   const StereoOptions& stereo, const RowOptions& rows,
                   const kys::DistanceModel& model, PriorProvider* priors)
    : camera_(camera),
      scales_(extractor->traits()),
      stereo_(stereo),
      rows_(checked(rows)),
      model_(&model),
      prior_provider_(priors),
      extractor_(std::move(extractor)) {
  check_options(stereo);
}

bool FrontEnd::attach_priors(const StereoFrame& frame, FrontEndResult& result) {
  if (prior_provider_ == nullptr || !model_->uses_priors()) return false;
  if (!prior_provider_->look_up(frame, features_[0].keypoints, features_[1].keypoints, priors_[0],
                                priors_[1])) {
    return false;
  }
  const std::span<const kys::Prior> segments = prior_provider_->segments();
  result.segments.assign(segments.begin(), segments.end());
  if (instances_raised_by_ > 0) {
    for (auto* priors : {&priors_[0], &priors_[1], &result.segments}) {
      raise(*priors, instances_raised_by_, is_thing_, frame);
    }
  }
  for (std::size_t side = 0; side < 2; ++side) {
    const std::vector<kys::Prior>& priors = priors_[side];
    result.masked += drop_features(features_[side], priors_[side], [&](std::size_t i) {
      return model_->keeps_keypoint(priors[i]);
    });
  }
  std::size_t labelled = 0;
  for (const kys::Prior& prior : priors_[0]) labelled += prior.label != kys::kVoidLabel ? 1 : 0;
  result.prior_coverage =
      priors_[0].empty() ? 0
                         : static_cast<double>(labelled) / static_cast<double>(priors_[0].size());
  return true;
}

StereoView FrontEnd::view(std::size_t side, bool from_images) const {
  return {&features_[side], priors_[side], from_images ? &extractor_.pyramid(side) : nullptr};
}

/// Columns of the left keypoints in the right image, and rows of some.
RightPositions FrontEnd::match(bool from_images, kys::Statistics& statistics) {
  const StereoView left = view(0, from_images), right = view(1, from_images);
  RightPositions positions = match_stereo(camera_, scales_, left, right, stereo_, *model_,
                                          statistics, from_images ? &helper_ : nullptr, rig_);
  const bool judged = row_fit_.has_value();
  if (!rows_.enabled || (judged && !rig_.bends()) || frames_ > rows_.frames) {
    positions.v.clear();
  } else if (from_images) {
    positions.v = measure_rows(left, right, positions.u, rig_, judged ? kRowsLater : kRowsFirst);
  }
  return positions;
}

/// Whether rows are corrected from this frame on: decided once, by the first frame that shows
/// enough, before there is a map.
bool FrontEnd::judge_rows(const RightPositions& right) {
  if (row_fit_ || has_map_ || right.v.empty()) return false;
  std::vector<RowObservation> rows;
  for (std::size_t i = 0; i < right.v.size(); ++i) {
    if (std::isnan(right.v[i])) continue;
    const Keypoint& k = features_[0].keypoints[i];
    rows.push_back({{k.x, k.y, right.u[i], right.v[i]}, scales_.scale[k.octave]});
  }
  if (rows.size() < kLeastRows) return false;
  RowFit fit = fit_rows(camera_, rows, {rig_, prior_});
  const bool bent = fit.field > rows_.min_field;
  if (bent) rig_ = fit.rig.correction;
  row_fit_ = std::move(fit);
  return bent;
}

FrontEndResult FrontEnd::process(const StereoFrame& frame, const StereoMasks& masks) {
  FrontEndResult result;
  Stopwatch watch;
  const bool from_images = !frame.left_features;
  if (from_images) {
    extractor_.extract(frame.left, frame.right,
                       frame.name.empty() ? std::to_string(frame.index) : frame.name, features_);
    result.left = &extractor_.pyramid(0);
  } else {
    features_ = {*frame.left_features, *frame.right_features};
  }
  result.fault = camera_faults_.check(features_[0], features_[1], camera_.width, camera_.height);
  result.repeated = camera_faults_.left_repeated();
  ++frames_;
  result.times.extract = watch.lap_ms();

  const bool with_priors = attach_priors(frame, result);
  if (!with_priors) priors_ = {};
  for (std::size_t side = 0; side < 2; ++side) {
    const GrayImage& mask = side == 0 ? masks.left : masks.right;
    if (mask.empty()) continue;
    const std::vector<Keypoint>& keypoints = features_[side].keypoints;
    result.masked += drop_features(features_[side], priors_[side],
                                   [&](std::size_t i) { return !is_masked(mask, keypoints[i]); });
  }
  result.times.priors = watch.lap_ms();

  RightPositions right = match(from_images, result.statistics);
  if (judge_rows(right)) {
    result.statistics = {};
    right = match(from_images, result.statistics);
  }
  result.stereo_matches = static_cast<int>(
      std::count_if(right.u.begin(), right.u.end(), [](float u) { return !std::isnan(u); }));
  result.features = std::make_shared<const FrameFeatures>(
      camera_, std::move(features_[0]), std::move(right), std::move(priors_[0]), rig_);
  features_[0] = {};
  priors_[0].clear();
  result.times.stereo = watch.lap_ms();
  return result;
}

void FrontEnd::renew(FrontEndResult& result) const {
  if (result.features->rig() == rig_) return;
  result.features = std::make_shared<const FrameFeatures>(result.features->with_rig(rig_));
}

}  // namespace kys_slam
