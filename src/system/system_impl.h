// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>
#include <kys_slam/system.h>
#include <kys_slam/util/interrupt.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "system/back_end.h"
#include "system/late_segments.h"
#include "system/object_log.h"
#include "system/private_access.h"
#include "system/relative_frame_poses.h"
#include "system/restart.h"
#include "system/segment_queue.h"
#include "system/settings_data.h"
#include "system/system_options.h"
#include "tracking/front_end.h"
#include "tracking/tracker.h"

namespace kys_slam {

/// What a System owns.
struct System::Impl {
  Impl(const StereoCamera& camera_in, const Settings& settings, Schedule schedule,
       std::unique_ptr<PriorProvider> priors_in, std::unique_ptr<FeatureExtractor> extractor)
      : camera(camera_in),
        options(as_strict_for(extractor->traits(), PrivateAccess::data(settings))),
        model(make_model(options)),
        priors(std::move(priors_in)),
        scales(extractor->traits()),
        front_end(camera, std::move(extractor), options.stereo, row_options(options), model,
                  priors.get()),
        tracker(camera, scales, tracker_options(options), model, make_belief_start(options, model)),
        runner(camera, scales, back_end_options(options), model, schedule,
               options.control.pipeline_delay),
        segments(options.control.segments, schedule),
        objects(options.objects) {}

  void check_input(const StereoFrame& frame, const StereoMasks& masks) const;
  FrameReport feed(const StereoFrame& frame, const StereoMasks& masks);
  void observe(const FrameReport& report, const FrameFeatures& features,
               std::span<const InstanceState> instances);
  /// The map while no frame is fed and the back end rests; `lock` holds it there.
  const Map& quiet_map(const std::unique_lock<std::mutex>& lock);
  void apply(std::vector<BackEndStep> steps);
  void note_loop(const BackEndStep& step);
  void take_joint(BackEndStep step);
  [[nodiscard]] TrackerInput input(const StereoFrame& frame, const FrontEndResult& seen) const {
    return {count, frame.timestamp, seen.features, seen.left, seen.repeated, seen.segments};
  }
  TrackResult resume(const StereoFrame& frame, FrontEndResult& seen, bool elsewhere);
  TrackResult recover(const StereoFrame& frame, FrontEndResult& seen, TrackResult lost);
  TrackResult find(const StereoFrame& frame, FrontEndResult& seen);
  struct Place {
    KeyFrameId submap;
    Rigid3 T_w_c;
  };
  [[nodiscard]] std::optional<Place> place(std::size_t frame) const;
  [[nodiscard]] KeyFrameId main_submap() const;
  void drain();
  std::size_t labels();
  std::vector<SegmentQueue::Delivery> take_segments(const FrontEndResult& seen);
  std::int64_t attach_segments(const StereoFrame& frame, FrontEndResult& seen,
                               const std::vector<SegmentQueue::Delivery>& arrived);
  void track(const StereoFrame& frame, FrontEndResult& seen,
             const std::vector<SegmentQueue::Delivery>& arrived, FrameReport& report);
  void record(TrackResult tracked, const FrontEndResult& seen, const FrameReport& report);
  bool must_hold(const std::vector<SegmentQueue::Delivery>& arrived, const FrontEndResult& seen);
  void hold(const StereoFrame& frame, const FrontEndResult& seen, FrameReport& report);
  void track_held(const std::vector<SegmentQueue::Delivery>& arrived);
  void note(const TrackResult& tracked, const FrontEndResult& seen, FrameReport& report) const;
  void note_uncertainty(const TrackResult& tracked, FrameReport& report) const;
  void note_masks(const StereoMasks& masks, FrameReport& report) const;
  bool drop_same_image(const StereoFrame& frame, FrontEndResult& seen);
  /// Both as 8-bit grey, by the bits that the first pair uses.
  void set_images(const ImageView& left, const ImageView& right, StereoFrame& frame);

  std::mutex mutex;  // held while a frame is fed and while the map is read
  bool finished = false;
  bool map_loaded = false;
  FrameObserver observer;
  // Of the frame fed last, for the observer.
  FrameReport seen_report;
  std::shared_ptr<const FrameFeatures> seen_features;
  std::vector<Keypoint> seen_keypoints;  // where they are in the image
  std::vector<float> seen_depths;
  std::vector<std::int64_t> seen_landmarks;
  std::vector<kys::Tier> seen_tiers;
  std::vector<ObservedInstance> seen_instances;

  StereoCamera camera;
  SettingsData options;
  kys::DistanceModel model;
  std::unique_ptr<PriorProvider> priors;
  ScaleLevels scales;
  FrontEnd front_end;
  Tracker tracker;
  BackEndRunner runner;
  SegmentQueue segments;
  std::once_flag labels_known;
  std::vector<std::uint8_t> is_thing;         // by label
  std::int32_t instance_end = 0;              // of a loaded map
  std::optional<LateSegments> late_segments;  // once there are some
  /// A frame before there is a map: with beliefs a map starts with segments, if some are expected.
  struct HeldFrame {
    StereoFrame frame;  // without images
    FrontEndResult seen;
    ImagePyramid left;
  };
  std::vector<HeldFrame> held;  // the last frames
  ObjectLog objects;
  FrameReports reports;
  RelativeFramePoses frame_poses;  // of every frame fed
  std::vector<std::int64_t>
      keyframe_frames;           // indices of frames, by keyframe id from first_keyframe
  std::int64_t count = 0;        // frames fed: the index everything inside goes by
  KeyFrameId first_keyframe{0};  // older ones come from a loaded map
  std::int64_t same_images = 0;  // frames from the first one on whose two images are the same
  int bits = 0;                  // of 16-bit views, 8 to 16; 0: no pair yet that shows it
  std::string first_note;        // a warning of the next frame's report
  InterruptibleWait stall;
  Restart restart{options.relocalization.patience};
};

}  // namespace kys_slam
