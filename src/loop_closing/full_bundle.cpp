// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closing/full_bundle.h"

#include <kys_slam/check_options.h>
#include <kys_slam/util/memory.h>

#include <algorithm>
#include <utility>

namespace kys_slam {

void describe(kys::OptionList& list, FullBundleOptions& o) {
  list.add("full_bundle.enabled", o.enabled, "bundle adjustment of the whole map after a loop");
  list.add("full_bundle.min_delay", o.min_delay, {0, 1e9}, "keyframes",
           "keyframes after which the result of a full bundle adjustment is applied, plus one per "
           "full_bundle.keyframes_per_step");
  list.add("full_bundle.keyframes_per_step", o.keyframes_per_step, {1, 1e9}, "",
           "keyframes of the map per additional keyframe of delay (full_bundle.min_delay)");
  describe(list, o.bundle, "full_bundle.");
}

namespace {

bool same(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

}  // namespace

FullBundle::FullBundle(const FullBundleOptions& options, bool threaded)
    : options_(checked(options)) {
  if (threaded && options.enabled) worker_ = std::make_unique<Worker>();
}

FullBundle::~FullBundle() {
  stop_ = true;  // the worker joins its thread; what the job threw is dropped
  worker_.reset();
}

void FullBundle::start(const Map& map, KeyFrameId submap, KeyFrameId current) {
  cancel();
  if (!options_.enabled || interrupted_) return;
  auto job = std::make_unique<Job>();
  job->submap = submap;
  job->rig = map.rig();
  job->keyframes = map.submap_keyframes(submap);
  job->problem.camera = map.camera();
  for (const KeyFrameId id : job->keyframes) {
    const KeyFrame& keyframe = map.keyframe(id);
    job->problem.T_c_w.push_back(keyframe.T_c_w);
    job->problem.pose_fixed.push_back(keyframe.parent.valid() ? 0 : 1);
  }
  map.landmarks().for_each([&](LandmarkId id, const Landmark& landmark) {
    if (map.keyframe(landmark.reference).submap == submap) job->landmarks.push_back(id);
  });
  static_cast<void>(add_landmarks(map, job->keyframes, job->landmarks, job->problem));
  add_motions(map, job->keyframes, job->problem);
  job->T_c_w = job->problem.T_c_w;
  job->points = job->problem.points;
  const auto size = static_cast<int>(job->keyframes.size());
  job->due = {current.value +
              static_cast<std::uint32_t>(options_.min_delay +
                                         size / std::max(1, options_.keyframes_per_step))};
  job_ = std::move(job);
  const auto work = [this] {
    BundleOptions bundle = options_.bundle;
    bundle.stop = &stop_;
    job_->summary = adjust_bundle(job_->problem, bundle);
    job_->done = true;
    return_freed_memory();
  };
  if (worker_) {
    worker_->start(work);
  } else {
    work();
  }
}

void FullBundle::cancel() {
  if (!job_) return;
  stop_ = true;
  if (worker_) worker_->wait();
  job_.reset();
  stop_ = interrupted_.load();
}

void FullBundle::interrupt() {
  interrupted_ = true;
  stop_ = true;
}

bool FullBundle::take_over_if_due(Map& map, KeyFrameId current) {
  return job_ && !(current < job_->due) && finish(map);
}

bool FullBundle::finish(Map& map) {
  if (!job_) return false;
  if (worker_) worker_->wait();
  const std::unique_ptr<Job> job = std::move(job_);
  if (!job->done) return false;  // it failed, and its poses are half changed
  // A corrected disparity stretches the map: what was computed before does not fit it any more.
  if (interrupted_ || job->summary.stopped || map.rig() != job->rig) {
    return false;
  }
  take_over(map, *job);
  return true;
}

void FullBundle::take_over(Map& map, const Job& job) const {
  IdTable<KeyFrameId, Rigid3> corrected;
  for (std::size_t k = 0; k < job.keyframes.size(); ++k) {
    const KeyFrameId id = job.keyframes[k];
    if (!map.has(id) || job.summary.unconstrained[k] != 0) continue;
    // What local mapping did meanwhile stays: the correction comes on top.
    const Rigid3& now = map.keyframe(id).T_c_w;
    corrected.put(id, same(now, job.T_c_w[k])
                          ? job.problem.T_c_w[k]
                          : now * job.T_c_w[k].inverse() * job.problem.T_c_w[k]);
  }
  // Keyframes made meanwhile, or held by too little, follow their parents, oldest first along the
  // spanning tree; landmarks that only they see follow them.
  const std::vector<KeyFrameId> ids = map.submap_keyframes(job.submap);
  for (const KeyFrameId id : ids) {
    std::vector<KeyFrameId> path;
    for (KeyFrameId k = id; k.valid() && !corrected.contains(k); k = map.keyframe(k).parent) {
      path.push_back(k);
    }
    for (auto k = path.rbegin(); k != path.rend(); ++k) {
      const KeyFrame& keyframe = map.keyframe(*k);
      if (!keyframe.parent.valid()) {
        corrected.put(*k, keyframe.T_c_w);
        continue;
      }
      const Rigid3 T_c_parent = keyframe.T_c_w * map.keyframe(keyframe.parent).T_c_w.inverse();
      corrected.put(*k, T_c_parent * corrected.at(keyframe.parent));
    }
  }
  const BundleProblem& problem = job.problem;
  const auto begin = problem.observations.begin();
  const auto constrained = [&](const auto& o) { return job.summary.unconstrained[o.pose] == 0; };
  std::vector<std::pair<LandmarkId, Eigen::Vector3d>> positions;
  for (std::size_t k = 0; k < job.landmarks.size(); ++k) {
    if (!map.has(job.landmarks[k])) continue;
    if (std::none_of(begin + problem.first[k], begin + problem.first[k + 1], constrained)) continue;
    const Eigen::Vector3d since = map.landmark(job.landmarks[k]).p_w - job.points[k];
    positions.emplace_back(job.landmarks[k], problem.points[k] + since);
  }
  std::vector<Rigid3> T_c_w;
  T_c_w.reserve(ids.size());
  for (const KeyFrameId id : ids) T_c_w.push_back(corrected.at(id));
  map.move_keyframes(ids, T_c_w);
  for (const auto& [id, p_w] : positions) map.set_position(id, p_w);
  for (std::size_t k = 0; k < job.landmarks.size(); ++k) {
    for (auto i = problem.first[k]; i < problem.first[k + 1]; ++i) {
      if (job.summary.outlier[static_cast<std::size_t>(i)] == 0) continue;
      if (!map.has(job.landmarks[k])) break;
      map.remove_observation(job.landmarks[k], job.keyframes[begin[i].pose]);
    }
  }
  for (const auto& entry : positions) {
    if (map.has(entry.first)) map.refresh_geometry(entry.first);
  }
}

}  // namespace kys_slam
