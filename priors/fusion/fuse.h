// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/prior_writer.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "priors/fusion/depth.h"
#include "priors/fusion/detection.h"
#include "priors/fusion/ego_motion.h"
#include "priors/fusion/fusion_times.h"
#include "priors/fusion/options.h"
#include "priors/fusion/panoptic.h"
#include "priors/fusion/residual.h"

namespace kys_slam {

/// Perception of one camera at one frame.
struct CameraPerception {
  PanopticMap panoptic;
  std::vector<std::int32_t> instances;  ///< of the segments, as they go into the file
  ImageOf<float> disparity;             ///< px, NaN where unknown; empty: no depth
  std::optional<FlowField> flow;        ///< to the next frame, px; none at the last frame
  const GrayImage* now = nullptr;       ///< if `now` and `next` are given, appearance is compared
  const GrayImage* next = nullptr;
};

/// Result of fusion, for tables and images.
struct CameraFusion {
  CameraPriors priors;
  std::vector<InputSegment> segments;         ///< of the input
  std::vector<SegmentStatistics> statistics;  ///< per segment
  std::vector<MotionDecision> decisions;      ///< per segment; default values for stuff
  std::optional<EgoMotion> ego_motion;        ///< none: no flow, or too few pixels
  BackgroundReferences background;
  FusionTimes times;
};

/// One camera and frame, measured but not decided.
struct MeasuredCamera {
  CameraFusion fusion;     ///< without priors and decisions
  CameraPerception input;  ///< the parts that export_camera() needs
  ImageOf<float> lengths;  ///< px, of the corrected residuals of things
};

/// Secs. 3.2 and 3.3 up to the statistics of the segments.
/// \param images if given, receives the results of the intermediate stages
MeasuredCamera measure_camera(const BuilderOptions& options, const StereoCamera& camera,
                              CameraPerception perception, FusionImages* images = nullptr);
/// Eqs. 7 and 8, each segment separately.
void decide_segments(const BuilderOptions& options, CameraFusion& fusion);
/// Converts decisions to priors. A pixel of a flagged segment without a residual gets the mean of
/// the segment. With detection.method robust every pixel gets the score of the segment.
CameraFusion export_camera(const BuilderOptions& options, MeasuredCamera measured);

/// Secs. 3.2 (scale) and 3.3 for one camera and frame: perception in, priors out: measure_camera(),
/// decide_segments() and export_camera().
/// \param images if given, receives the results of the intermediate stages
CameraFusion fuse_camera(const BuilderOptions& options, const StereoCamera& camera,
                         CameraPerception perception, FusionImages* images = nullptr);

}  // namespace kys_slam
