// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/feature_extractor.h>
#include <kys_slam/frame_observation.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/image_view.h>
#include <kys_slam/map_snapshot.h>
#include <kys_slam/masks.h>
#include <kys_slam/object.h>
#include <kys_slam/prior_provider.h>
#include <kys_slam/report.h>
#include <kys_slam/rig_rows.h>
#include <kys_slam/segment_image.h>
#include <kys_slam/settings.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace kys_slam {

/// When the back end runs, and when the tracker receives its changes.
enum class Schedule : std::uint8_t {
  kSequential,  ///< in the caller's thread, after tracking of the frame
  kPipelined,   ///< in parallel; its changes arrive a fixed number of frames later
  kRealtime,    ///< in parallel; its changes arrive when they are ready
};
/// \throws InputError for an unknown name.
Schedule parse_schedule(std::string_view name);
const char* to_string(Schedule schedule);

/// The calibration as the images show it.
struct RigReport {
  RigEstimate applied;         ///< to all measurements; zero covariance: not estimated
  std::optional<RowFit> rows;  ///< of the first frame that shows enough; nothing without images
  /// The latest estimate of the offset of disparities alone, px, applied or not. Nothing without
  /// one, and when all parameters are corrected.
  std::optional<OffsetEstimate> offset;

  /// "none", "offset" (of disparities alone) or "all": what is corrected.
  [[nodiscard]] const char* corrected() const;
  /// The applied correction with what is known about it: until the map shows more, by the rows.
  [[nodiscard]] const RigEstimate& known() const;
};

/// The SLAM system. Feed rectified stereo frames in order and get poses; get trajectory and map at
/// the end. With the schedules `sequential` and `pipelined` the results depend on the input and the
/// settings alone. Several systems can run in one process.
class System {
 public:
  /// \param priors source of the priors of keypoints; null: none
  /// \param features extractor of the features of images; null: ORB by the settings `orb.*`
  /// \throws InputError when a setting or a trait of the extractor is invalid
  System(const StereoCamera& camera, const Settings& settings, Schedule schedule,
         std::unique_ptr<PriorProvider> priors = nullptr,
         std::unique_ptr<FeatureExtractor> features = nullptr);
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  /// Loads a saved map, in which frames are relocalised. Call it before the first frame,
  /// once. With `localize_only` the map does not change. Otherwise frames that are not recognised
  /// start a sub-map, which is merged when a known place is seen. \throws InputError when the file
  /// is not a map, or a map of another camera, extractor, pyramid or label space
  /// \throws LogicError after the first frame or another map
  void load_map(const std::filesystem::path& file, bool localize_only = false);
  /// Saves the whole map for `load_map`; after `finish` with the last corrections. Before, it waits
  /// as the functions below do, and may be called from any thread. \throws InputError when the file
  /// cannot be written.
  void save_map(const std::filesystem::path& file) const;

  /// Begins with a correction of the given calibration and what it is worth, as
  /// `kys-slam calibrate` finds it, in place of none. Call it before the first frame.
  /// \throws LogicError after the first frame or a map, which has its own
  void start_rig(const RigEstimate& rig);

  /// Tracks the next frame. Images and masks must have the size of the camera. \throws InputError
  /// when they do not, or when time stamps do not increase
  /// \throws LogicError after `finish`
  FrameReport feed(const StereoFrame& frame, const StereoMasks& masks = {});
  /// The same from images in memory of the caller, copied once to 8-bit grey. Frames are numbered
  /// in order, from 0. \param timestamp s
  FrameReport feed(double timestamp, const ImageView& left, const ImageView& right,
                   const StereoMasks& masks = {});
  /// The segmentation of the left image of a frame, which may come late and for some frames only.
  /// From any thread. It takes effect when frame `frame` + control.segment_lag is fed, or the next
  /// one where that is past; in the schedule `realtime` with the next one fed. Later frames get its
  /// priors, moved with the scene and its instances, until the next segmentation; frames since its
  /// own, their keyframes and landmarks get theirs. A frame with priors of its own keeps these.
  ///
  /// Frames are kept for it from the first call on, or from the first frame with
  /// control.segment_every above 0. With control.segment_every = n frames 0, n, 2n, ... have one:
  /// `feed` waits for it where it takes effect (not `realtime`), so that results do not depend on
  /// when it came. It has to come before, or from another thread. After control.segment_timeout the
  /// run goes on without any. \param frame index of the frame as fed: 0, 1, ... \param image null:
  /// the frame has none \throws InputError for a wrong size or label, and for a frame given twice
  void add_segments(std::int64_t frame, std::shared_ptr<const SegmentImage> image);
  /// No more segmentations come: nothing is waited for. From any thread.
  void end_segments();

  /// Sets the function called after every following frame; empty: none.
  void set_observer(FrameObserver observer);

  /// Waits for the back end. Results are final afterwards, and no more frames can be fed.
  void finish();
  /// Stops running optimisation early, so that `finish` returns soon. Thread-safe.
  void interrupt();

  // The functions below may be called at any time and from any thread. They wait for the frame
  // being fed and, except `reports`, for the keyframes queued in the back end. They change nothing.

  /// One entry per frame fed.
  [[nodiscard]] std::vector<FrameEstimate> trajectory() const;
  /// Moving objects in the frames fed, by frame, then instance, in the frame of the trajectory. In
  /// mode `verified` only. Frames that are not connected have none.
  [[nodiscard]] std::vector<ObjectEstimate> objects() const;
  /// Keyframes of the frames fed, by time. Those of the sub-map in which the trajectory is
  /// expressed.
  [[nodiscard]] std::vector<TimedPose> keyframes() const;
  /// p_w (m) of the landmarks of the sub-map in which the trajectory is expressed, in its frame.
  [[nodiscard]] std::vector<Eigen::Vector3d> landmarks() const;
  /// A copy of the whole map.
  [[nodiscard]] MapSnapshot snapshot() const;
  /// What the images said about the calibration, and the correction that is applied.
  [[nodiscard]] RigReport rig() const;
  /// Number of sub-maps. Each has its own world frame; those that meet at a known place are merged.
  [[nodiscard]] std::size_t submaps() const;
  /// Reports of all frames fed. Results of the back end are included as far as its steps have
  /// reached the tracker; all of them after `finish`.
  [[nodiscard]] std::vector<FrameReport> reports() const;

 private:
  friend struct PrivateAccess;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
