// SPDX-License-Identifier: BSD-3-Clause
#include "tracking/tracker.h"

// How well the accepted pose of a frame is known.

#include <algorithm>

namespace kys_slam {

void Tracker::add_covariance(const Frame& frame, TrackResult& result) {
  std::vector<FrameCovariance::Seen> seen;
  for (std::size_t i = 0; i < frame.landmarks.size(); ++i) {
    const LandmarkView* landmark = replica_.landmarks().find(frame.landmarks[i]);
    if (landmark == nullptr) continue;
    const StereoPixel alone = frame.features->stereo_pixel(i, scales_);
    const StereoPixel pixel = pixel_of(frame, i, *landmark);
    const float own = pixel.inv_sigma / alone.inv_sigma;
    seen.push_back({frame.landmarks[i], pixel,
                    std::min(belief(landmark->prior), belief(frame.features->prior(i))),
                    own * own});
  }
  PoseUncertainty& uncertainty = result.uncertainty.emplace();
  uncertainty.reference = replica_.resolve(reference_).keyframe;
  const Rigid3 T_w_c = frame.T_c_w.inverse();
  uncertainty.T_reference_c = replica_.keyframes().at(uncertainty.reference).T_c_w * T_w_c;
  FrameCovariance::Frame input{.T_c_w = frame.T_c_w,
                               .reference = uncertainty.reference,
                               .held = frame.held,
                               .seen = seen,
                               .T_before_w = {},
                               .before = {}};
  if (result.relocalised || !last_) {
    covariance_.forget();
  } else {
    input.T_before_w = last_->T_c_w;
    const bool keyframe = last_keyframe_.valid() && last_keyframe_frame_ == last_->index;
    if (keyframe) input.before = replica_.resolve(last_keyframe_).keyframe;
    uncertainty.last = last_->index;
    uncertainty.T_last_c = last_->T_c_w * T_w_c;
  }
  uncertainty.covariance = covariance_.update(replica_, input);
  if (!uncertainty.covariance.motion) uncertainty.last = -1;
}

}  // namespace kys_slam
