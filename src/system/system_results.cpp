// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/logic_error.h>

#include <map>

#include "map/take_snapshot.h"
#include "system/system_impl.h"

/// What a System knows after its frames: poses, objects, the map.
namespace kys_slam {

/// Where a frame is; nothing for a frame without a pose. When the back end has failed, the frames
/// whose keyframe never reached the map are where the tracker saw them.
std::optional<System::Impl::Place> System::Impl::place(std::size_t frame) const {
  if (frame >= frame_poses.size()) return std::nullopt;  // feeding it failed
  if (const auto T_w_c = frame_poses.pose(runner.map(), frame)) {
    return Place{frame_poses.submap(runner.map(), frame), *T_w_c};
  }
  const FramePose& pose = frame_poses.before(frame);
  if (!pose.reference.valid()) return std::nullopt;
  const KeyFrameId submap = tracker.submap(pose.reference);
  if (!submap.valid()) return std::nullopt;
  return Place{submap, tracker.current_pose(pose).inverse()};
}

const Map& System::Impl::quiet_map(const std::unique_lock<std::mutex>& lock) {
  if (!lock.owns_lock()) throw LogicError("the map was read without its lock");
  runner.wait_idle();
  return runner.map();
}

/// The sub-map with most frames; of equals the oldest. The trajectory is expressed in its frame.
KeyFrameId System::Impl::main_submap() const {
  std::map<KeyFrameId, int> frames;
  for (std::size_t k = 0; k < frame_poses.size(); ++k) {
    if (const auto at = place(k)) ++frames[at->submap];
  }
  KeyFrameId main;
  int most = 0;
  for (const auto& [id, members] : frames) {
    if (members > most) {
      main = id;
      most = members;
    }
  }
  return main;
}

std::vector<FrameEstimate> System::trajectory() const {
  const std::unique_lock lock(impl_->mutex);
  impl_->quiet_map(lock);
  const KeyFrameId main = impl_->main_submap();
  std::vector<FrameEstimate> estimates;
  for (std::size_t k = 0; k < impl_->reports.size(); ++k) {
    const FrameReport& report = impl_->reports[k];
    FrameEstimate estimate;
    estimate.index = report.index;
    estimate.timestamp = report.timestamp;
    estimate.local = report.local;
    estimate.motion = report.motion;
    if (const auto at = impl_->place(k)) {
      estimate.submap = static_cast<std::int64_t>(at->submap.value);
      estimate.connected = at->submap == main;
      estimate.T_w_c = at->T_w_c;
    }
    estimates.push_back(estimate);
  }
  return estimates;
}

std::vector<ObjectEstimate> System::objects() const {
  const std::vector<FrameEstimate> estimates = trajectory();
  const std::unique_lock lock(impl_->mutex);
  return impl_->objects.objects(estimates);
}

std::vector<TimedPose> System::keyframes() const {
  const std::unique_lock lock(impl_->mutex);
  const Map& map = impl_->quiet_map(lock);
  const KeyFrameId main = impl_->main_submap();
  std::vector<TimedPose> poses;
  map.keyframes().for_each([&](KeyFrameId id, const KeyFrame& keyframe) {
    if (keyframe.submap != main || id < impl_->first_keyframe) return;
    poses.push_back({keyframe.timestamp, keyframe.T_c_w.inverse()});
  });
  return poses;
}

std::vector<Eigen::Vector3d> System::landmarks() const {
  const std::unique_lock lock(impl_->mutex);
  const Map& map = impl_->quiet_map(lock);
  const KeyFrameId main = impl_->main_submap();
  std::vector<Eigen::Vector3d> points;
  map.landmarks().for_each([&](LandmarkId, const Landmark& landmark) {
    if (map.submap(landmark.reference) == main) points.push_back(landmark.p_w);
  });
  return points;
}

RigReport System::rig() const {
  std::unique_lock lock(impl_->mutex);
  RigReport report{impl_->quiet_map(lock).rig_estimate(), impl_->front_end.rows(), {}};
  if (!report.applied.correction.bends()) report.offset = impl_->runner.offset();
  return report;
}

std::size_t System::submaps() const {
  const std::unique_lock lock(impl_->mutex);
  const Map& map = impl_->quiet_map(lock);
  std::size_t roots = 0;
  map.keyframes().for_each(
      [&](KeyFrameId, const KeyFrame& k) { roots += k.parent.valid() ? 0 : 1; });
  return roots;
}

MapSnapshot System::snapshot() const {
  const std::unique_lock lock(impl_->mutex);
  MapSnapshot snapshot = take_snapshot(impl_->quiet_map(lock));
  snapshot.frames = impl_->count;
  const KeyFrameId main = impl_->main_submap();
  if (main.valid()) snapshot.main_submap = main.value;
  return snapshot;
}

std::vector<FrameReport> System::reports() const {
  const std::lock_guard lock(impl_->mutex);
  return {impl_->reports.begin(), impl_->reports.end()};
}

const Map& PrivateAccess::map(const System& system) {
  return system.impl_->runner.map();
}

const FrameReports& PrivateAccess::reports(const System& system) {
  return system.impl_->reports;
}

}  // namespace kys_slam
