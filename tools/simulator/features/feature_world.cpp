// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/feature_world.h"

#include <kys_slam/check_options.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

#include "simulator/features/feature_detector.h"
#include "simulator/features/landmark_maker.h"
#include "simulator/features/landmarks.h"
#include "simulator/features/object_view.h"
#include "simulator/traffic/parked_cars.h"
#include "simulator/traffic/scenery.h"
#include "simulator/traffic/traffic.h"

namespace kys_slam::simulator {
namespace {

bool has_labels(const FeatureOptions& options) {
  return options.labelled || has_traffic(options);
}

// The objects given; without them parked cars, then the traffic.
std::vector<FeatureObject> objects_along(const FeaturePath& path, const FeatureOptions& options) {
  if (!has_labels(options) || !options.objects.empty()) return options.objects;
  std::vector<FeatureObject> objects = park_cars(path, options.seed);
  for (FeatureObject& o : make_traffic(path, options.traffic, options.seed)) {
    objects.push_back(std::move(o));
  }
  return objects;
}

// Of the same strength the older landmark.
std::vector<Sight> strongest_first(const std::vector<Sight>& sights, const LandmarkMap& landmarks) {
  std::vector<std::tuple<int, std::int32_t, std::size_t>> order;
  for (std::size_t i = 0; i < sights.size(); ++i) {
    order.emplace_back(-landmarks[sights[i].id].strength, sights[i].id, i);
  }
  std::ranges::sort(order);
  std::vector<Sight> sorted;
  sorted.reserve(sights.size());
  for (const auto& [strength, id, i] : order) sorted.push_back(sights[i]);
  return sorted;
}

// None when there is no error: then keypoints have the very bytes they have without the option.
std::optional<TruePair> true_pair(const FeaturePath& path, const FeatureOptions& options) {
  if (!options.rig_error) return {};
  TruePair pair(path.camera, *options.rig_error);
  if (*options.rig_error == RigError{}) return {};
  return pair;
}

}  // namespace

struct FeatureWorld::Impl {
  Impl(const FeaturePath& path_given, const FeatureOptions& options_given,
       const std::function<void(double)>& progress)
      : path(path_given),
        options(checked(options_given)),
        objects(objects_along(path, options)),
        pair(true_pair(path, options)),
        landmarks(make_landmarks(path, options, objects, progress)),
        detector(path, options, objects, landmarks, pair ? &*pair : nullptr) {
    if (has_labels(options)) label();
  }
  void label();
  [[nodiscard]] std::vector<Presence> present(std::size_t frame) const {
    return objects_near(path.poses[frame].T_w_c, landmarks.reach(), objects, frame);
  }

  FeaturePath path;
  FeatureOptions options;
  std::vector<FeatureObject> objects;
  std::optional<TruePair> pair;  ///< if the rig has an error
  LandmarkMap landmarks;
  FeatureDetector detector;
  std::optional<Scenery> scenery;           ///< of a labelled world
  std::vector<std::uint16_t> labels;        ///< by landmark, of a labelled world
  std::vector<std::int32_t> parked_around;  ///< by static landmark, or empty
};

// Classes of all landmarks; without traffic also the parked car that a landmark is in.
void FeatureWorld::Impl::label() {
  scenery.emplace(path, options.seed);
  for (const Landmark& l : landmarks.all()) {
    labels.push_back(l.object >= 0 ? objects[static_cast<std::size_t>(l.object)].label
                                   : scenery->label_of(l.p_w));
  }
  if (has_traffic(options)) return;
  parked_around.assign(landmarks.size(), -1);
  for (std::size_t o = 0; o < objects.size(); ++o) {
    const Eigen::Vector3d half = objects[o].half_size.cast<double>();
    const Rigid3& T_w_o = objects[o].poses.front();
    const Rigid3 T_o_w = T_w_o.inverse();
    for (const std::int32_t id : landmarks.static_near(T_w_o.t(), half.norm())) {
      const Eigen::Vector3d p = T_o_w * landmarks[id].p_w;
      if ((p.cwiseAbs() - half).maxCoeff() > 0.02) continue;
      const auto i = static_cast<std::size_t>(id);
      parked_around[i] = static_cast<std::int32_t>(o);
      labels[i] = objects[o].label;
    }
  }
}

FeatureWorld::FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
                           const std::function<void(double)>& progress)
    : impl_(std::make_unique<Impl>(path, options, progress)) {}

FeatureWorld::~FeatureWorld() = default;

std::size_t FeatureWorld::landmark_count() const {
  return impl_->landmarks.size();
}
Eigen::Vector3d FeatureWorld::landmark_position(std::int32_t id) const {
  return impl_->landmarks.all().at(static_cast<std::size_t>(id)).p_w;
}
std::int32_t FeatureWorld::object_of(std::int32_t id) const {
  return impl_->landmarks.all().at(static_cast<std::size_t>(id)).object;
}
std::int32_t FeatureWorld::segment_of(std::int32_t id) const {
  const std::int32_t object = object_of(id);
  if (object >= 0 || impl_->parked_around.empty()) return object;
  return impl_->parked_around.at(static_cast<std::size_t>(id));
}
std::uint16_t FeatureWorld::label_of(std::int32_t id) const {
  return impl_->labels.at(static_cast<std::size_t>(id));
}
const std::vector<FeatureObject>& FeatureWorld::objects() const {
  return impl_->objects;
}
const Scenery& FeatureWorld::scenery() const {
  return *impl_->scenery;
}
const FeaturePath& FeatureWorld::path() const {
  return impl_->path;
}
Eigen::Vector2d FeatureWorld::ideal_pixel(int camera, double u, double v) const {
  const std::optional<TruePair>& pair = impl_->pair;
  if (!pair) return {u, v};
  const StereoCamera& k = impl_->path.camera;
  const Eigen::Vector2d ideal = camera == 0 ? pair->left_ideal(u, v) : pair->right_ideal_far(u, v);
  return {std::clamp(ideal.x(), 0.0, k.width - 1.0), std::clamp(ideal.y(), 0.0, k.height - 1.0)};
}
FrameScene FeatureWorld::scene(std::size_t index) const {
  const Impl& w = *impl_;
  return scene_of(w.path.camera, w.path.poses[index].T_w_c, w.objects, w.present(index));
}

FeatureTruth FeatureWorld::truth() const {
  FeatureTruth truth;
  truth.objects = impl_->objects;
  for (std::size_t i = 0; i < impl_->landmarks.size(); ++i) {
    const Landmark& l = impl_->landmarks.all()[i];
    truth.landmarks.push_back({l.p_w.cast<float>(), l.object, impl_->labels.at(i)});
  }
  return truth;
}

FeatureFileInfo FeatureWorld::info() const {
  FeatureFileInfo info{impl_->path.camera, kFeatureScale, kFeatureLevels, impl_->options.seed,
                       impl_->path.poses};
  info.version = impl_->labels.empty() ? 1 : 2;
  return info;
}

FeatureFrame FeatureWorld::frame(std::size_t index) const {
  const Impl& w = *impl_;
  const StereoCamera& camera = w.path.camera;
  const TimedPose& pose = w.path.poses[index];
  std::vector<Sight> sights = w.landmarks.static_sights(camera, pose.T_w_c);
  FeatureFrame out;
  std::optional<FrameScene> scene;
  if (has_traffic(w.options)) {
    const std::vector<Presence> present = w.present(index);
    scene = scene_of(camera, pose.T_w_c, w.objects, present);
    for (const Presence& p : present) {
      const FeatureObject& object = w.objects[static_cast<std::size_t>(p.object)];
      if (!may_show(object, p, *scene)) continue;
      add_sights_on(object, p, camera, pose, w.landmarks, sights);
    }
    hide(*scene, camera, w.landmarks, sights);
    out.mover_share = scene->mover_share;
  }
  sights = strongest_first(sights, w.landmarks);
  w.detector.observe(index, 0, sights, scene ? &scene->left_raster : nullptr,
                     {out.left, out.left_landmarks, out.left_origins});
  w.detector.observe(index, 1, sights, scene ? &scene->right_raster : nullptr,
                     {out.right, out.right_landmarks, out.right_origins});
  return out;
}

}  // namespace kys_slam::simulator
