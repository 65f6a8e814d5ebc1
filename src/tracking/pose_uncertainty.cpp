// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/pose_uncertainty.h"

#include <algorithm>
#include <vector>

#include "tracking/pose_estimation.h"
#include "tracking/tracked_frame.h"
#include "tracking/tracking_context.h"

namespace kys_slam {

namespace {

/// The inliers with their weights in the pose estimation.
std::vector<FrameCovariance::Seen> inliers_of(const TrackingContext& context,
                                              const TrackedFrame& frame) {
  std::vector<FrameCovariance::Seen> seen;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const LandmarkView* landmark = context.replica.landmarks().find(frame.landmarks[i]);
    if (landmark == nullptr) continue;
    const StereoPixel alone = frame.features->stereo_pixel(i, context.scales);
    const StereoPixel pixel = pixel_of(context, *frame.features, i, landmark->observers.size());
    const float own = pixel.inv_sigma / alone.inv_sigma;
    const float share = std::min(context.beliefs.weight(landmark->prior),
                                 context.beliefs.weight(frame.features->prior(i)));
    seen.push_back({frame.landmarks[i], pixel, share, own * own});
  }
  return seen;
}

}  // namespace

PoseUncertainty uncertainty_of(const TrackingContext& context, const TrackedFrame& frame,
                               bool continues, KeyFrameId last_keyframe,
                               FrameCovariance& covariance) {
  const Replica& replica = context.replica;
  const Rigid3 T_w_c = frame.T_c_w.inverse();
  const std::vector<FrameCovariance::Seen> seen = inliers_of(context, frame);
  PoseUncertainty result;
  result.reference = replica.resolve(context.reference).keyframe;
  result.T_reference_c = replica.keyframes().at(result.reference).T_c_w * T_w_c;
  FrameCovariance::Frame input;
  input.T_c_w = frame.T_c_w;
  input.reference = result.reference;
  input.held = frame.held;
  input.seen = seen;
  if (continues && context.last != nullptr) {
    input.T_before_w = context.last->T_c_w;
    if (last_keyframe.valid()) input.before = replica.resolve(last_keyframe).keyframe;
    result.last = context.last->index;
    result.T_last_c = context.last->T_c_w * T_w_c;
  } else {
    covariance.forget();
  }
  result.covariance = covariance.update(replica, input);
  if (!result.covariance.motion) result.last = -1;
  return result;
}

}  // namespace kys_slam
