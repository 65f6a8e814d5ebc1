#pragma once

#include <kys_slam/prior_writer.h>
#include <kys_slam/stereo_camera.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "priors/builder/depth.h"
#include "priors/builder/detection.h"
#include "priors/builder/ego_motion.h"
#include "priors/builder/fusion_times.h"
#include "priors/builder/options.h"
#include "priors/builder/panoptic.h"
#include "priors/builder/residual.h"

namespace kys_slam {

/// Perception of one camera at one frame.
struct CameraPerception {
  PanopticMap panoptic;
  std::vector<std::int32_t> instances;  ///< of the segments, as they go into the file
  ImageOf<float> disparity;             ///< px, NaN where unknown; empty: no depth
  std::optional<FlowField> flow;        ///< to the next frame, px; none at the last frame
  const GrayImage* now = nullptr;       ///< with `next`: appearance is compared
  const GrayImage* next = nullptr;
};

/// What fusion found out, for the tables and the pictures.
struct CameraFusion {
  CameraPriors priors;
  std::vector<InputSegment> segments;         ///< as they were given
  std::vector<SegmentStatistics> statistics;  ///< per segment
  std::vector<MotionDecision> decisions;      ///< per segment; of stuff: nothing
  std::optional<EgoMotion> ego_motion;        ///< none: no flow, or too few pixels
  BackgroundReferences background;
  FusionTimes times;
};

/// One camera and frame, measured but not decided.
struct MeasuredCamera {
  CameraFusion fusion;     ///< priors and decisions are still to come
  CameraPerception input;  ///< what is left of it
  ImageOf<float> lengths;  ///< px, of the corrected residuals of things
};

/// Secs. 3.2 and 3.3 up to the statistics of the segments.
/// \param images when given, what the stages in between gave.
MeasuredCamera measure_camera(const BuilderOptions& options, const StereoCamera& camera,
                              CameraPerception perception, FusionImages* images = nullptr);
/// Eqs. 7 and 8, every segment by itself.
void decide_segments(const BuilderOptions& options, CameraFusion& fusion);
/// From decisions to priors. A pixel of a flagged segment without a residual of its own gets the
/// segment's mean. (detection.method robust: every pixel has the segment's score.)
CameraFusion export_camera(const BuilderOptions& options, MeasuredCamera measured);

/// Secs. 3.2 (scale) and 3.3 for one camera and frame: perception in, priors out. A pixel of a
/// flagged segment without a residual of its own gets the segment's mean.
/// \param images when given, what the stages in between gave.
CameraFusion fuse_camera(const BuilderOptions& options, const StereoCamera& camera,
                         CameraPerception perception, FusionImages* images = nullptr);

}  // namespace kys_slam
