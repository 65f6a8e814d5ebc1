#pragma once

#include <kys_slam/frame_observation.h>
#include <kys_slam/frame_source.h>
#include <kys_slam/image_view.h>
#include <kys_slam/map_snapshot.h>
#include <kys_slam/masks.h>
#include <kys_slam/object.h>
#include <kys_slam/prior_provider.h>
#include <kys_slam/report.h>
#include <kys_slam/settings.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace kys_slam {

/// When the back end runs and when the tracker sees what it did.
enum class Schedule : std::uint8_t {
  kSequential,  ///< in program order, in the caller's thread
  kPipelined,   ///< beside the tracker; its changes arrive a fixed number of frames later
  kRealtime,    ///< beside the tracker; its changes arrive when they are ready
};
/// \throws InputError for an unknown name.
Schedule parse_schedule(std::string_view name);
const char* to_string(Schedule schedule);

/// The SLAM system: feed rectified stereo frames in order, get poses; ask for trajectory and map at
/// the end. With the schedules `sequential` and `pipelined` the results depend on the input and the
/// settings alone. Two systems can run in one process.
class System {
 public:
  /// \param priors where the priors of keypoints come from; null: none
  /// \throws InputError when a setting makes no sense
  System(const StereoCamera& camera, const Settings& settings, Schedule schedule,
         std::unique_ptr<PriorProvider> priors = nullptr);
  ~System();
  System(const System&) = delete;
  System& operator=(const System&) = delete;

  /// Before the first frame: goes on with a map saved earlier, in which the frames are looked for.
  /// With `localize_only` it stays as it is; otherwise frames that are not recognised start a
  /// sub-map, which is merged when a known place is seen.
  /// \throws InputError when the file is not such a map, or one of another camera, pyramid or label
  ///   space
  void load_map(const std::filesystem::path& file, bool localize_only = false);
  /// After `finish`: the whole map, for `load_map`. \throws InputError when it cannot be written.
  void save_map(const std::filesystem::path& file) const;

  /// Tracks the next frame. Images, and masks where there are any, have to be of the camera's size.
  /// \throws InputError when they are not, or when time stamps do not increase
  /// \throws LogicError after `finish`
  FrameReport feed(const StereoFrame& frame, const StereoMasks& masks = {});
  /// The same from a camera's own memory, which is copied once into 8-bit grey. Frames are numbered
  /// as they come. \param timestamp s
  FrameReport feed(double timestamp, const ImageView& left, const ImageView& right,
                   const StereoMasks& masks = {});
  /// Called after every frame that is fed from now on; empty: none.
  void set_observer(FrameObserver observer);

  /// Waits for the back end; what follows is final. No frame can be fed afterwards.
  void finish();
  /// Asks optimisation under way to stop early; `finish` then returns soon. From any thread.
  void interrupt();

  // The functions from here on may be called at any time and from any thread: they wait for the
  // frame being fed and, but for `reports`, for the keyframes in the back end's hands, and change
  // nothing.

  /// One entry per frame fed.
  [[nodiscard]] std::vector<FrameEstimate> trajectory() const;
  /// Moving things in the frames fed, by frame, then instance, in the frame of the trajectory; in
  /// mode `verified` only, which judges what moves. Frames that the trajectory does not connect
  /// have none.
  [[nodiscard]] std::vector<ObjectEstimate> objects() const;
  /// Keyframes made of the frames fed, by time, those of the sub-map the trajectory is expressed
  /// in.
  [[nodiscard]] std::vector<TimedPose> keyframes() const;
  /// p_w (m) of the landmarks of the sub-map the trajectory is expressed in, in its frame.
  [[nodiscard]] std::vector<Eigen::Vector3d> landmarks() const;
  /// The whole map as it is now.
  [[nodiscard]] MapSnapshot snapshot() const;
  /// Sub-maps that were never connected, each with a frame of its own.
  [[nodiscard]] std::size_t submaps() const;
  /// Reports of all frames fed, those of the back end filled in as far as its steps have reached
  /// the tracker; all of them after `finish`.
  [[nodiscard]] std::vector<FrameReport> reports() const;

 private:
  friend struct PrivateAccess;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace kys_slam
