// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <Eigen/Core>
#include <optional>

#include "map/frame_features.h"
#include "matching/landmark_search.h"

namespace kys_slam {

/// Predicted pixel and octave of a landmark in a view.
struct PredictedView {
  Eigen::Vector3d pixel;  ///< u_left, v, u_right, px
  float cosine = 0;       ///< between the ray and the landmark's mean viewing direction
  int octave = 0;
};

/// Predicts the view of a landmark from T_c_w. Nothing when it is behind the camera, outside the
/// image, outside its distance range, or viewed at more than 60 degrees from its mean direction
/// (ORB-SLAM, Sec. V-D).
/// \param landmark a type with p_w, normal, min_distance, max_distance
/// \param centre the camera's centre in the world, T_c_w.inverse_t()
template <typename LandmarkType>
std::optional<PredictedView> predict_view(const StereoCamera& camera, const ScaleLevels& scales,
                                          const Rigid3& T_c_w, const Eigen::Vector3d& centre,
                                          const LandmarkType& landmark) {
  const Eigen::Vector3d p_c = T_c_w * landmark.p_w;
  if (p_c.z() <= 0) return std::nullopt;
  PredictedView view;
  view.pixel = camera.project_stereo(p_c);
  if (!camera.in_image(view.pixel.x(), view.pixel.y())) return std::nullopt;
  const Eigen::Vector3d ray = landmark.p_w - centre;
  const auto distance = static_cast<float>(ray.norm());
  if (distance < 0.8f * landmark.min_distance || distance > 1.2f * landmark.max_distance) {
    return std::nullopt;
  }
  view.cosine = ray.cast<float>().dot(landmark.normal) / distance;
  if (view.cosine < 0.5f) return std::nullopt;
  view.octave = scales.predict_octave(landmark.max_distance, distance);
  return view;
}

/// The query for a landmark with this prediction: `radius` px at octave 0, the predicted octave and
/// the one below.
inline SearchQuery query_for(const PredictedView& view, float radius, const ScaleLevels& scales,
                             const kys::Descriptor& descriptor, const kys::Prior& prior) {
  SearchQuery query;
  query.u = static_cast<float>(view.pixel.x());
  query.v = static_cast<float>(view.pixel.y());
  query.u_right = static_cast<float>(view.pixel.z());
  query.radius = radius * scales.scale[static_cast<std::size_t>(view.octave)];
  query.min_octave = scales.lowest(view.octave - 1);
  query.max_octave = scales.highest(view.octave);
  query.descriptor = &descriptor;
  query.prior = &prior;
  return query;
}

}  // namespace kys_slam
