// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/distance_model.h>
#include <kys_slam/image.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "map/frame_features.h"
#include "matching/landmark_search.h"
#include "motion/instance_motion.h"
#include "motion/leave_out.h"
#include "priors/fusion/detection.h"
#include "priors/fusion/mask_association.h"
#include "priors/fusion/options.h"
#include "priors/fusion/panoptic.h"

namespace kys_slam {

/// The segments of one camera at one frame.
struct CameraSegments {
  const PanopticMap* panoptic = nullptr;
};

/// Judges thing segments by stereo keypoints tracked from frame to frame. The keypoints on stuff
/// give the motion of the camera. The motion of each segment is tested against it with the test of
/// the tracker (motion/instance_motion.h). Optical flow is not used.
class KeypointMotion {
 public:
  /// Evidence by camera and segment.
  using Evidence = std::vector<std::vector<KeypointEvidence>>;

  KeypointMotion(const StereoCamera& camera, const BuilderOptions::Keypoints& options);

  /// Stereo keypoints of a rectified pair. Thread-safe.
  [[nodiscard]] std::shared_ptr<const FrameFeatures> extract(const GrayImage& left,
                                                             const GrayImage& right) const;

  /// The next frame, in order. \param cameras left, and right if there is one
  /// \return evidence for the segments of the frame before; empty for the first frame. Default
  /// values for stuff and for segments that cannot be compared.
  /// \param links receives the keypoints found on two segments
  Evidence next_frame(double timestamp, std::shared_ptr<const FrameFeatures> features,
                      std::span<const CameraSegments> cameras, SegmentLinks& links);

  /// Number of frames before the last one whose relative camera pose is known.
  [[nodiscard]] std::size_t frames_back() const { return frames_.empty() ? 0 : frames_.size() - 1; }
  /// Pose of the left camera relative to the frame `back` <= frames_back() frames before the last
  /// one.
  [[nodiscard]] Rigid3 T_before_last(std::size_t back) const {
    return frames_[back].T_c_w * frames_[0].T_c_w.inverse();
  }

 private:
  struct Frame {
    double timestamp = 0;
    std::shared_ptr<const FrameFeatures> features;
    std::array<std::vector<std::uint16_t>, 2> segments;  // by camera and keypoint; 0: none
    std::array<std::vector<bool>, 2> things;             // by camera and segment number
    std::vector<std::int32_t> back;  // by keypoint: its match in the frame before; -1: none
    Rigid3 T_c_w;
    PoseIncrement error;  // of T_c_w; its covariance
  };
  struct Step {
    Rigid3 T_now_last;
    Matrix6d covariance;
    std::size_t inliers = 0;
  };
  [[nodiscard]] Frame make_frame(double timestamp, std::shared_ptr<const FrameFeatures> features,
                                 std::span<const CameraSegments> cameras) const;
  [[nodiscard]] bool on_thing(const Frame& frame, std::size_t i) const;
  [[nodiscard]] std::optional<Step> camera_step(const Frame& now) const;
  [[nodiscard]] std::optional<Step> camera_step(const Frame& now, const Rigid3& expected,
                                                double radius) const;
  struct Candidate {
    std::size_t keypoint = 0;  // of the last frame
    Eigen::Vector3d still;     // m, in the camera now, if it is static
  };
  [[nodiscard]] std::vector<SearchMatch> search(const Frame& now,
                                                const std::vector<Candidate>& candidates,
                                                const std::vector<Eigen::Vector3d>& shifts,
                                                bool wide) const;
  void follow(Frame& now) const;
  void link(const Frame& now, SegmentLinks& links) const;
  void add_common_error(const std::vector<InstanceMatch>& matches, CameraMotion& ego) const;
  [[nodiscard]] KeypointEvidence judge(const Frame& now, std::size_t c,
                                       std::uint16_t segment) const;

  StereoCamera camera_;
  ScaleLevels scales_;
  BuilderOptions::Keypoints options_;
  InstanceMotionOptions test_;
  kys::DistanceModel model_;
  Rigid3 T_now_last_;         ///< of the last step
  std::deque<Frame> frames_;  ///< latest first
};

}  // namespace kys_slam
