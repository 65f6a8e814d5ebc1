// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys/belief.h>
#include <kys/distance_model.h>
#include <kys_slam/segment_image.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "motion/instance_tracker.h"
#include "motion/segment_carrier.h"
#include "tracking/tracker.h"

namespace kys_slam {

/// Segmentations of earlier frames, carried to the present one. Keeps the last frames with their
/// poses. When a segmentation of frame s arrives before frame n is tracked,
///
/// - its instances get the identities of those before it, carried to s (same_segments);
/// - the frames s..n-1 are judged again with its segments (InstanceTracker), so that beliefs and
///   velocities are those of a segmentation in time;
/// - keyframes and landmarks made since s get its priors.
///
/// Every later frame gets its priors from the same segmentation, moved with the scene or with its
/// instances (SegmentCarrier), until the next one arrives. Deterministic.
class LateSegments {
 public:
  /// \param model must outlive this
  /// \param start of every class that can move
  /// \param memory s, for which a segmentation is carried
  LateSegments(const StereoCamera& camera, const ScaleLevels& scales,
               const InstanceTrackerOptions& options, const kys::DistanceModel& model,
               const kys::InitialBelief& start, std::vector<std::uint8_t> is_thing, double memory);

  /// Identities are above those of a loaded map.
  void continue_after(std::int32_t instance_end);

  /// Before frame `now` is tracked: the segmentation of frame `frame`. False: that frame is
  /// unknown or lost.
  /// \param features of frame `now`
  bool arrive(std::int64_t frame, std::shared_ptr<const SegmentImage> image, std::int64_t now,
              double timestamp, const std::shared_ptr<const FrameFeatures>& features,
              Tracker& tracker);
  /// The frame whose segments are carried; -1: none yet.
  [[nodiscard]] std::int64_t latest() const { return base_frame_; }
  /// Priors of a frame that has none, before it is tracked; empty: nothing to carry.
  [[nodiscard]] std::vector<kys::Prior> carry(double timestamp, const FrameFeatures& features,
                                              const Tracker& tracker);
  /// After it is tracked.
  void add(std::int64_t index, const TrackResult& tracked,
           std::shared_ptr<const FrameFeatures> features, const Tracker& tracker);

 private:
  static constexpr std::size_t kMostFrames = 100;
  static constexpr std::size_t kOlder = 2;  // segmentations that give names besides the last

  /// A segmentation, and how far its instances have moved since.
  struct Carried {
    std::shared_ptr<const SegmentCarrier> segments;
    FramePose pose;                   // of its image
    double taken = 0;                 // s, of its image
    double until = 0;                 // s, of the shifts
    SegmentShifts moved;              // m, in the world
    std::vector<std::uint8_t> known;  // flags: `moved` is measured
  };
  /// Beliefs after one frame.
  struct Judged {
    InstanceTracker instances;
    std::deque<FramePose> poses;  // of the frames it keeps, latest first
    Rigid3 T_c_w;                 // of the latest, then
    double taken = -1e300;        // s, of the latest
  };
  struct State {
    Judged judged;
    std::optional<Carried> carried;  // nothing: no segmentation yet
  };
  struct Frame {
    std::int64_t index = 0;
    double taken = 0;  // s
    std::shared_ptr<const FrameFeatures> features;
    std::vector<LandmarkId> landmarks;   // per feature
    std::optional<FramePose> pose;       // nothing: lost
    std::optional<KeyFrameId> keyframe;  // that it became
    std::shared_ptr<const State> after;  // it
  };

  void forget();
  [[nodiscard]] Carried begin(std::shared_ptr<const SegmentImage> image, const Frame& frame,
                              std::vector<kys::Prior> named) const;
  [[nodiscard]] std::vector<kys::Prior> name(const SegmentImage& image, const Frame& frame,
                                             const Rigid3& T_c_w, const InstanceTracker& beliefs,
                                             const Carried* before, const Tracker& tracker);
  void take_names(const Carried& before, const SegmentCarrier& now, const Rigid3& T_c_w,
                  double taken, const InstanceTracker& beliefs, const Tracker& tracker,
                  std::vector<kys::Prior>& named) const;
  void keep_older(const std::optional<Carried>& last);
  [[nodiscard]] SegmentShifts shifts_at(const Carried& carried, double taken,
                                        const InstanceTracker& beliefs, const Rigid3& T_s_w) const;
  [[nodiscard]] std::vector<kys::Prior> priors_at(const Carried& carried, double taken,
                                                  const Rigid3& T_c_w,
                                                  const FrameFeatures& features,
                                                  const InstanceTracker& beliefs,
                                                  const Tracker& tracker) const;
  void advance(Carried& carried, double taken, const InstanceTracker& beliefs) const;
  void judge(Judged& judged, const Frame& frame, const std::vector<kys::Prior>& priors,
             std::span<const kys::Prior> segments, const Tracker& tracker) const;
  void replay(State& state, std::size_t first, const Tracker& tracker,
              std::vector<LatePriors>& late);
  [[nodiscard]] std::optional<Rigid3> expected_pose(double timestamp, const Tracker& tracker) const;
  [[nodiscard]] const InstanceTracker& beliefs(const Tracker& tracker) const {
    return tracker.instances().in_use() ? *tracker.instances().tracker()
                                        : latest_state().judged.instances;
  }
  /// After the last frame.
  [[nodiscard]] const State& latest_state() const {
    return frames_.empty() ? *before_ : *frames_.back().after;
  }

  StereoCamera camera_;
  ScaleLevels scales_;
  SegmentSearch search_;
  kys::InitialBelief start_;
  std::vector<std::uint8_t> is_thing_;
  double memory_;  // s
  std::int32_t next_identity_ = 65536 /* as in prior files */;
  std::deque<Frame> frames_;             // oldest first
  std::shared_ptr<const State> before_;  // the first of these
  std::int64_t base_frame_ = -1;         // of the last segmentation
  std::deque<Carried> older_;            // segmentations before the last, latest first
  // Of the frame to be tracked next, when it has its own segmentation.
  std::shared_ptr<const SegmentImage> own_image_;
  std::vector<kys::Prior> own_named_;
};

}  // namespace kys_slam
