// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/perception/perception.h"

#include <kys/label_space.h>
#include <kys/prior.h>
#include <kys_slam/error.h>
#include <kys_slam/prior_format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "simulator/common/coco_classes.h"
#include "simulator/common/rng.h"
#include "simulator/traffic/object_motion.h"
#include "simulator/traffic/scenery.h"

namespace kys_slam::simulator {
namespace {

constexpr double kBlockArea = BoxRaster::kBlock * BoxRaster::kBlock;  // px^2
constexpr double kLeastArea = 48;   // px^2 of the level, of a thing that is a segment
constexpr double kFloor = 0.1;      // px of the camera, of the reference (Eq. 7)
constexpr int kStuffBlock = 16;     // px, stuff of outliers is looked up by blocks
constexpr double kUnitArea = 1000;  // px^2
constexpr double kStill = 1e-3;     // px: less is no motion
// Corners gather where two segments meet, and their keypoints are on either side: as if all were
// this far (px of the level, standard deviation) from where they are.
constexpr double kCornerSpread = 2;
// Share of the things of kUnitArea that are not recognised as one in both images.
constexpr double kUnlinked = 0.13;
constexpr std::int32_t kFirstThing = 65536;  // numbers below are those of stuff

const std::vector<PerceptionLevel>& measured_levels() {
  static const std::vector<PerceptionLevel> levels{
#include "simulator/perception/perception_levels.inc"
  };
  return levels;
}

// Estimated motion, and segments as bad as a network gives on images it was not trained for.
PerceptionLevel poor_level() {
  PerceptionLevel poor = measured_levels().at(1);
  poor.name = "poor";
  poor.moving0 -= 0.7;
  poor.still0 += 0.7;
  poor.scale_sd = std::max(0.4, poor.scale_sd);
  poor.by_centroid = true;
  poor.boundary = 3;
  poor.confusion = 0.08;
  poor.stuff_confusion = 0.08;
  poor.missed = 0.15;
  poor.merged = 0.10;
  poor.missing_frames = 0.02;
  poor.late_frames = 0.05;
  return poor;
}

double logistic(double x) {
  return 1 / (1 + std::exp(-x));
}

// The standard normal distribution function.
double normal_below(double x) {
  return 0.5 * std::erfc(-x / std::sqrt(2.0));
}

double falling(double probability, double area) {
  return std::min(0.9, probability * std::sqrt(kUnitArea / std::max(area, 1.0)));
}

// Of every class the one of its kind (thing, stuff) whose name is nearest to its own.
std::vector<std::uint16_t> nearest_classes() {
  const kys::LabelSpace space = kys::load_label_space(kFeatureLabelSpace);
  std::vector<std::uint16_t> nearest(space.size());
  const auto classes = static_cast<std::uint16_t>(space.size());
  for (std::uint16_t a = 0; a < classes; ++a) {
    float least = std::numeric_limits<float>::infinity();
    for (std::uint16_t b = 0; b < classes; ++b) {
      if (a == b || space.at(a).thing != space.at(b).thing || space.distance(a, b) >= least) {
        continue;
      }
      least = space.distance(a, b);
      nearest[a] = b;
    }
  }
  return nearest;
}

}  // namespace

const PerceptionLevel& perception_level(const std::string& name) {
  static const PerceptionLevel poor = poor_level();
  for (const PerceptionLevel& level : measured_levels()) {
    if (name == level.name) return level;
  }
  if (name == poor.name) return poor;
  throw InputError("--perception: must be none, exact, estimated or poor");
}

Perception::Perception(const FeatureWorld& world, const PerceptionLevel& level, std::uint64_t seed)
    : world_(world),
      level_(level),
      shrink_(static_cast<double>(level.width) / world.path().camera.width),
      seed_(hash_of(seed, 30)),
      sides_{Side(BuilderOptions::Association{}), Side(BuilderOptions::Association{})},
      nearest_class_(nearest_classes()) {}

// A standard normal deviate of an object that changes slowly from frame to frame.
double Perception::latent(int kind, int camera, std::int32_t object, std::size_t index,
                          double persistence) {
  Rng rng(hash_of(hash_of(seed_, static_cast<std::uint64_t>(kind)),
                  static_cast<std::uint64_t>(camera + 1), static_cast<std::uint64_t>(object),
                  index));
  const double fresh = rng.gaussian();
  const auto [at, is_new] = latents_.try_emplace({kind, camera, object}, index, fresh);
  auto& [last, value] = at->second;
  if (is_new || last == index) return value;
  const double kept = std::pow(persistence, static_cast<double>(index - last));
  value = kept * value + std::sqrt(1 - kept * kept) * fresh;
  last = index;
  return value;
}

std::uint16_t Perception::confused(std::uint16_t label) const {
  return label < nearest_class_.size() ? nearest_class_[label] : label;
}

// One segment per object that covers enough of the image.
void Perception::outline_segments(std::size_t index, int camera, View& view) {
  std::map<std::int32_t, Segment> found;
  const BoxRaster& raster = *view.raster;
  for (int y = 0; y < raster.rows(); ++y) {
    for (int x = 0; x < raster.columns(); ++x) {
      const auto at = static_cast<std::size_t>(y * raster.columns() + x);
      const std::int32_t object = raster.objects()[at];
      if (object < 0) continue;
      Segment& s = found[object];
      s.area += kBlockArea;
      s.u += kBlockArea * (x + 0.5) * BoxRaster::kBlock;
      s.v += kBlockArea * (y + 0.5) * BoxRaster::kBlock;
      s.depth += kBlockArea * raster.depths()[at];
    }
  }
  for (auto& [object, s] : found) {
    s.u /= s.area;
    s.v /= s.area;
    s.depth /= s.area;
    const double area = s.area * shrink_ * shrink_;
    if (area < kLeastArea) continue;
    const bool missed = normal_below(latent(1, camera, object, index, level_.persistence)) <
                        falling(level_.missed, area);
    if (missed) continue;
    s.prior.label = world_.objects()[static_cast<std::size_t>(object)].label;
    if (normal_below(latent(2, camera, object, index, level_.persistence)) <
        falling(level_.confusion, area)) {
      s.prior.label = confused(s.prior.label);
    }
    view.segment_of[object] = view.segments.size();
    view.segments.push_back(s);
  }
}

// Neighbours of one class become one segment.
void Perception::merge(std::size_t index, int camera, View& view) {
  if (level_.merged <= 0) return;
  for (auto& [object, at] : view.segment_of) {
    Segment& s = view.segments[at];
    if (normal_below(latent(3, camera, object, index, level_.persistence)) >=
        falling(level_.merged, s.area * shrink_ * shrink_)) {
      continue;
    }
    for (auto& [other, other_at] : view.segment_of) {
      const Segment& o = view.segments[other_at];
      const double reach = 0.75 * (std::sqrt(s.area) + std::sqrt(o.area));
      if (other_at == at || o.prior.label != s.prior.label ||
          std::hypot(o.u - s.u, o.v - s.v) > reach) {
        continue;
      }
      at = other_at;
      break;
    }
  }
}

// By the overlap of masks, as the builder associates by default: an object keeps its identity, in
// both images, until it is not seen for too long.
std::int32_t Perception::identity_of(std::size_t index, std::int32_t object) {
  const auto kept = static_cast<std::size_t>(BuilderOptions::Association{}.max_missed_frames) + 1;
  const auto [at, is_new] = identities_.try_emplace(object);
  Identity& identity = at->second;
  if (is_new || index - identity.seen > kept) identity.number = next_identity_++;
  identity.seen = index;
  return kFirstThing + identity.number;
}

void Perception::identify(std::size_t index, int camera, View& view) {
  if (level_.by_centroid) {
    std::vector<Detection> detections;
    for (const Segment& s : view.segments) detections.push_back({s.prior.label, s.u, s.v});
    const auto identities =
        sides_[static_cast<std::size_t>(camera)].associator.next_frame(detections);
    const std::int32_t base = camera == 0 ? 0 : prior_format::kRightInstances;
    for (std::size_t i = 0; i < identities.size(); ++i) {
      view.segments[i].prior.instance = base + kFirstThing + identities[i];
    }
    return;
  }
  for (const auto& [object, at] : view.segment_of) {
    Segment& s = view.segments[at];
    std::int32_t own = identity_of(index, object);
    const double area = s.area * shrink_ * shrink_;
    if (camera == 1 && normal_below(latent(5, camera, object, index, level_.persistence)) <
                           falling(kUnlinked, area)) {
      own += prior_format::kRightInstances;
    }
    // Merged things have the identity of the oldest.
    s.prior.instance = s.prior.instance < 0 ? own : std::min(s.prior.instance, own);
  }
}

// Motion of a point of an object in the image to the next frame, less that of a static point, px.
Eigen::Vector2d Perception::image_motion(std::size_t index, int camera, std::int32_t object,
                                         double u, double v, double depth) const {
  const FeaturePath& path = world_.path();
  const FeatureObject& o = world_.objects()[static_cast<std::size_t>(object)];
  const Rigid3* now = pose_in_frame(o, index);
  const Rigid3* then = pose_in_frame(o, index + 1);
  if (now == nullptr || then == nullptr || index + 1 >= path.poses.size()) return {0, 0};
  const double b = camera == 0 ? 0 : path.camera.baseline;
  const Eigen::Vector3d p_c = path.camera.back_project(u, v, depth) + Eigen::Vector3d(b, 0, 0);
  const Eigen::Vector3d p_w = path.poses[index].T_w_c * p_c;
  const Rigid3 T_c_w = path.poses[index + 1].T_w_c.inverse();
  const Eigen::Vector3d still = T_c_w * p_w - Eigen::Vector3d(b, 0, 0);
  const Eigen::Vector3d moved = T_c_w * (*then * (now->inverse() * p_w)) - Eigen::Vector3d(b, 0, 0);
  if (still.z() < 0.2 || moved.z() < 0.2) return {0, 0};
  return path.camera.project(moved) - path.camera.project(still);
}

// Eqs. 7 and 8 with a level's errors.
void Perception::judge_motion(std::size_t index, int camera, View& view) {
  Rng frame_rng(hash_of(seed_, 7, static_cast<std::uint64_t>(camera), index));
  view.reference = std::max(
      kFloor * shrink_, level_.reference * std::exp(level_.reference_sd * frame_rng.gaussian()));
  if (index + 1 >= world_.path().poses.size()) return;  // no flow
  std::vector<bool> judged(view.segments.size(), false);
  for (const auto& [object, at] : view.segment_of) {
    if (judged[at]) continue;
    judged[at] = true;
    Segment& s = view.segments[at];
    const double r = shrink_ * image_motion(index, camera, object, s.u, s.v, s.depth).norm();
    const double size = std::log(s.area * shrink_ * shrink_ / kUnitArea);
    s.truly_moves = r > kStill;
    const double odds = s.truly_moves
                            ? level_.moving0 + level_.moving1 * std::log(r) + level_.moving2 * size
                            : level_.still0 + level_.still1 * size;
    const double both = latent(4, -1, object, index, level_.persistence);
    const double own = latent(4, camera, object, index, level_.persistence);
    const bool flagged = normal_below((both + own) / std::sqrt(2.0)) < logistic(odds);
    ++(s.truly_moves ? score_.moving : score_.still);
    if (!flagged) continue;
    ++(s.truly_moves ? score_.moving_flagged : score_.still_flagged);
    Rng rng(hash_of(hash_of(seed_, 8), static_cast<std::uint64_t>(camera),
                    static_cast<std::uint64_t>(object), index));
    const double noise = rng.gaussian();
    s.motion = s.truly_moves ? r / view.reference * std::exp(level_.motion_sd * noise)
                             : level_.false_rho * std::exp(level_.false_rho_sd * noise);
    const double logarithm = std::log1p(std::min(s.motion, 100.0));
    s.weight = std::min(5 * logarithm * logarithm, 100.0) / 100;
    s.prior.dynamic = 1;
  }
}

// Scale of stuff, from the landmarks on it: its share of the image and its mean depth.
void Perception::measure_stuff(std::size_t index, int camera, const FeatureFrame& frame,
                               View& view) const {
  struct Sum {
    double count = 0, depth = 0;
  };
  std::map<std::uint16_t, Sum> sums;
  double all = 0;
  const Rigid3 T_c_w = world_.path().poses[index].T_w_c.inverse();
  for (const std::int32_t id : camera == 0 ? frame.left_landmarks : frame.right_landmarks) {
    if (id < 0) continue;
    ++all;
    if (world_.segment_of(id) >= 0) continue;
    Sum& sum = sums[world_.label_of(id)];
    ++sum.count;
    sum.depth += (T_c_w * world_.landmark_position(id)).z();
  }
  const StereoCamera& k = world_.path().camera;
  for (const auto& [label, sum] : sums) {
    const double depth = sum.depth / sum.count;
    const double area = sum.count / all * k.width * k.height;
    view.stuff_scale[label] = static_cast<float>(area * depth * depth);
  }
}

void Perception::make_segments(std::size_t index, int camera, const FrameScene& scene,
                               const FeatureFrame& frame) {
  Side& side = sides_[static_cast<std::size_t>(camera)];
  side.before = std::move(side.now);
  side.now = {};
  View& view = side.now;
  view.raster = std::make_unique<BoxRaster>(camera == 0 ? scene.left_raster : scene.right_raster);
  outline_segments(index, camera, view);
  merge(index, camera, view);
  identify(index, camera, view);
  judge_motion(index, camera, view);
  measure_stuff(index, camera, frame, view);
  for (const auto& [object, at] : view.segment_of) {
    Segment& s = view.segments[at];
    Rng rng(hash_of(hash_of(seed_, 9), static_cast<std::uint64_t>(camera),
                    static_cast<std::uint64_t>(object), index));
    s.prior.scale =
        static_cast<float>(s.area * s.depth * s.depth * std::exp(level_.scale_sd * rng.gaussian()));
  }
}

std::uint16_t Perception::stuff_at(std::size_t index, const Keypoint& k) {
  const StereoCamera& camera = world_.path().camera;
  const int columns = camera.width / kStuffBlock + 1;
  if (stuff_cache_.empty() || stuff_cache_of_ != index) {
    stuff_cache_.assign(static_cast<std::size_t>(columns) *
                            static_cast<std::size_t>(camera.height / kStuffBlock + 1),
                        -1);
    stuff_cache_of_ = index;
  }
  const int x = static_cast<int>(k.x) / kStuffBlock;
  const int y = static_cast<int>(k.y) / kStuffBlock;
  std::int32_t& label = stuff_cache_[static_cast<std::size_t>(y * columns + x)];
  if (label < 0) {
    label = world_.scenery().label_at(index, (x + 0.5) * kStuffBlock, (y + 0.5) * kStuffBlock);
  }
  return static_cast<std::uint16_t>(label);
}

kys::Prior Perception::of_stuff(int camera, const View& view, std::uint16_t label,
                                const Keypoint& k, std::size_t index) const {
  if (label == kys::kVoidLabel) return {};
  const auto scale = view.stuff_scale.find(label);
  const float a = scale == view.stuff_scale.end() ? 0 : scale->second;
  if (level_.stuff_confusion > 0) {
    // Blocks of 64 px, for half a second.
    Rng rng(hash_of(hash_of(seed_, 10, static_cast<std::uint64_t>(camera)),
                    static_cast<std::uint64_t>(k.x / 64), static_cast<std::uint64_t>(k.y / 64),
                    index / 5));
    if (rng.chance(level_.stuff_confusion)) label = confused(label);
  }
  const std::int32_t base = camera == 1 && level_.by_centroid ? prior_format::kRightInstances : 0;
  return kys::make_prior(label, base + label, a, 0, false);
}

/// Class of the static world `aside_u` px to the right of a landmark, at its depth.
std::uint16_t Perception::label_beside(std::int32_t landmark, std::size_t index,
                                       double aside_u) const {
  if (aside_u == 0) return world_.label_of(landmark);
  const Eigen::Vector3d p_w = world_.landmark_position(landmark);
  const Rigid3& T_w_c = world_.path().poses[index].T_w_c;
  const double depth = (T_w_c.inverse() * p_w).z();
  const double metres = aside_u * depth / world_.path().camera.fx;
  return world_.scenery().label_of(p_w + T_w_c.rotation * Eigen::Vector3d(metres, 0, 0));
}

kys::Prior Perception::prior_of(std::size_t index, int camera, const View& view, bool late,
                                const Keypoint& k, std::int32_t landmark, std::size_t number) {
  std::int32_t object = view.raster->object_at(k.x, k.y);
  const bool own_scenery = landmark >= 0 && world_.segment_of(landmark) < 0;
  double aside_u = 0;
  if (landmark >= 0 && !late) {
    const std::int32_t in_image = object;
    object = world_.segment_of(landmark);
    Rng rng(hash_of(hash_of(seed_, 11, static_cast<std::uint64_t>(camera)), index, number));
    const double spread = std::hypot(level_.boundary, kCornerSpread) / shrink_;
    aside_u = spread * rng.gaussian();
    const double v = k.y + spread * rng.gaussian();
    const std::int32_t aside = view.raster->object_at(k.x + aside_u, v);
    if (aside != in_image) object = aside;
  }
  const auto found = view.segment_of.find(object);
  if (found == view.segment_of.end()) {
    const std::uint16_t label =
        own_scenery ? label_beside(landmark, index, aside_u) : stuff_at(index, k);
    return of_stuff(camera, view, label, k, index);
  }
  const Segment& s = view.segments[found->second];
  double mu = 0;
  if (s.motion > 0) {
    double rho = s.motion;
    if (s.truly_moves && !late) {
      // The pixel's own motion, as wrong as the segment's.
      const double middle = image_motion(index, camera, object, s.u, s.v, s.depth).norm();
      const double depth = view.raster->depth_at(k.x, k.y);
      const bool known = view.raster->object_at(k.x, k.y) == object && middle > kStill;
      if (known) rho *= image_motion(index, camera, object, k.x, k.y, depth).norm() / middle;
    }
    mu = std::min(100.0, rho * s.weight);
  }
  return kys::make_prior(s.prior.label, s.prior.instance, s.prior.scale, static_cast<float>(mu),
                         s.prior.dynamic != 0);
}

void Perception::add_priors(std::size_t index, FeatureFrame& frame) {
  const FrameScene scene = world_.scene(index);
  Rng rng(hash_of(seed_, 12, index));
  const bool missing = rng.chance(level_.missing_frames);
  const bool asked_late = rng.chance(level_.late_frames);
  for (int camera = 0; camera < 2; ++camera) {
    make_segments(index, camera, scene, frame);
    const Side& side = sides_[static_cast<std::size_t>(camera)];
    const bool late = asked_late && index > 0;
    const View& view = late ? side.before : side.now;
    const FeatureSet& set = camera == 0 ? frame.left : frame.right;
    const auto& ids = camera == 0 ? frame.left_landmarks : frame.right_landmarks;
    auto& priors = camera == 0 ? frame.left_priors : frame.right_priors;
    priors.clear();
    for (std::size_t i = 0; i < set.size() && !missing; ++i) {
      // The scene is known as the given cameras see it.
      Keypoint k = set.keypoints[i];
      const Eigen::Vector2d ideal = world_.ideal_pixel(camera, k.x, k.y);
      k.x = static_cast<float>(ideal.x());
      k.y = static_cast<float>(ideal.y());
      priors.push_back(prior_of(index, camera, view, late, k, ids[i], i));
    }
  }
  frame.has_priors = !missing;
}

}  // namespace kys_slam::simulator
