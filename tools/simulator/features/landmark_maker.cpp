// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/landmark_maker.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "simulator/common/rng.h"
#include "simulator/features/feature_detector.h"
#include "simulator/features/object_view.h"
#include "simulator/traffic/object_motion.h"

namespace kys_slam::simulator {
namespace {

constexpr double kMinCone = 0.21;    // rad, half the angle a landmark is seen from: 12 degrees
constexpr double kMaxCone = 0.79;    // 45 degrees
constexpr double kShortSpan = 0.25;  // octaves that a landmark is found at, mean: half of them
constexpr double kLongSpan = 1.2;    // the others
constexpr double kUnlimited = 1e6;   // m, from where a landmark on an object is found at most
// What objects have more of than the static world, chosen so that a rendered street and the same
// street of features agree on the shares of keypoints and of matches that movers hold.
constexpr double kDensity = 1.7;  // of landmarks

// A landmark at a point seen by the camera, to be found at `octave` from there. T_a_c: of the frame
// that the landmark is in; farthest: m, never found from beyond.
Landmark new_landmark(const Rigid3& T_a_c, const Eigen::Vector3d& p_c, int octave, double farthest,
                      Rng& rng) {
  Landmark l;
  l.p_w = T_a_c * p_c;
  const Eigen::Vector3d view = -p_c.normalized();
  const double cone = rng.uniform(kMinCone, kMaxCone);
  l.min_cosine = static_cast<float>(std::cos(cone));
  Eigen::Vector3d normal = (view + 0.4 * std::tan(cone) * rng.gaussian3()).normalized();
  if (normal.dot(view) < std::cos(0.8 * cone)) normal = view;
  const Eigen::Vector3d tangent = rng.gaussian3().cross(normal).normalized();
  l.normal = (T_a_c.rotation * normal).cast<float>();
  l.tangent = (T_a_c.rotation * tangent).cast<float>();
  const double level = octave + rng.uniform(0.02, 0.98);
  l.max_distance =
      static_cast<float>(std::min(p_c.norm() * std::pow(kFeatureScale, level), farthest));
  // Found for the first time somewhere in its span, most often at the beginning: from afar.
  const double factor = -std::log(1.0 - rng.uniform());
  const double span = factor * (rng.chance(0.5) ? kShortSpan : kLongSpan);
  l.max_level = static_cast<float>(level + 0.05 + span);
  const double strength = rng.uniform();
  l.strength = static_cast<std::uint8_t>(20 + 100 * strength * strength);
  return l;
}

OctaveCounts count_by_octave(const std::vector<Sight>& sights) {
  OctaveCounts n{};
  for (const Sight& s : sights) ++n[static_cast<std::size_t>(s.level)];
  return n;
}

// Adds landmarks frame by frame.
class LandmarkMaker {
 public:
  LandmarkMaker(const FeaturePath& path, const FeatureOptions& options,
                const std::vector<FeatureObject>& objects, LandmarkMap& landmarks)
      : path_(path), options_(options), objects_(objects), landmarks_(landmarks) {}

  void populate(std::size_t frame);
  void populate_objects(std::size_t frame);

 private:
  void add(std::size_t frame, int octave, Rng& rng);
  void add_to(const SeenBox& box, int octave, Rng& rng);

  const FeaturePath& path_;
  const FeatureOptions& options_;
  const std::vector<FeatureObject>& objects_;
  LandmarkMap& landmarks_;
  OctaveCounts quota_ = feature_quota(path_, options_);
};

// A new landmark in the view of a frame, to be found at `octave` from there.
void LandmarkMaker::add(std::size_t frame, int octave, Rng& rng) {
  const StereoCamera& k = path_.camera;
  const Rigid3& T_w_c = path_.poses[frame].T_w_c;
  const double u = rng.uniform(kMargin, k.width - kMargin);
  const double v = rng.uniform(kMargin, k.height - kMargin);
  double depth = path_.near * std::pow(path_.far / path_.near, rng.uniform());
  const double down = (v - k.cy) / k.fy;
  const bool on_ground = path_.ground > 0 && down > 0 && depth * down > path_.ground;
  if (on_ground) depth = path_.ground / down;
  landmarks_.add(
      new_landmark(T_w_c, k.back_project(u, v, depth), octave, landmarks_.reach() - 1e-3, rng));
}

void LandmarkMaker::populate(std::size_t frame) {
  const OctaveCounts found =
      count_by_octave(landmarks_.static_sights(path_.camera, path_.poses[frame].T_w_c));
  Rng rng(hash_of(options_.seed, 1, frame));
  for (int octave = 0; octave < kFeatureLevels; ++octave) {
    const auto o = static_cast<std::size_t>(octave);
    const int wanted = static_cast<int>(quota_[o] * 1.05 / (1 - options_.dropout) / (1 - kMissed));
    for (int i = found[o]; i < wanted; ++i) add(frame, octave, rng);
  }
}

// A new landmark on a box where the left camera sees it. A box that ends beside the camera gets its
// landmarks anywhere in the image: near parts that soon leave the image are not filled.
void LandmarkMaker::add_to(const SeenBox& box, int octave, Rng& rng) {
  const StereoCamera& k = path_.camera;
  const double u0 = box.reaches_past ? 0 : box.u0, u1 = box.reaches_past ? k.width : box.u1;
  const double v0 = box.reaches_past ? 0 : box.v0, v1 = box.reaches_past ? k.height : box.v1;
  for (int attempt = 0; attempt < 8; ++attempt) {
    const double u = rng.uniform(std::max(u0, kMargin), std::min(u1, k.width - kMargin));
    const double v = rng.uniform(std::max(v0, kMargin), std::min(v1, k.height - kMargin));
    if (!within_margin(k, u, v)) continue;
    const Eigen::Vector3d ray((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
    const double depth = depth_of_hit(box, ray);
    if (!std::isfinite(depth) || depth < 0.2) continue;
    Landmark l = new_landmark(box.T_o_c, depth * ray, octave, kUnlimited, rng);
    Eigen::Index axis = 0;
    (l.p_w.array() / box.half.array()).abs().maxCoeff(&axis);
    const bool upper = l.p_w[axis] > 0;
    l.p_w[axis] = (upper ? 1 : -1) * box.half[axis];
    // On a body the same corners are seen over a long way; a short life would mean that a car which
    // comes near needs thousands of them.
    l.max_level = static_cast<float>(octave + 1 - kLongSpan * std::log(1 - rng.uniform()));
    l.face = static_cast<std::int8_t>((axis + 1) * (upper ? 1 : -1));
    l.object = box.object;
    landmarks_.add(l);
    return;
  }
}

// Landmarks on an object by the area it covers, as dense as those of the static world that this
// frame could see there, and denser by kDensity.
void LandmarkMaker::populate_objects(std::size_t frame) {
  const StereoCamera& k = path_.camera;
  const TimedPose& pose = path_.poses[frame];
  const FrameScene scene = scene_of(k, pose.T_w_c, objects_,
                                    objects_near(pose.T_w_c, landmarks_.reach(), objects_, frame));
  std::unordered_map<std::int32_t, int> blocks;
  for (const std::int32_t id : scene.left_raster.objects()) {
    if (id >= 0) ++blocks[id];
  }
  if (blocks.empty()) return;
  const OctaveCounts still = count_by_octave(landmarks_.static_sights(k, pose.T_w_c));
  const double all = static_cast<double>(scene.left_raster.objects().size());
  std::vector<Sight> sights;
  for (const SeenBox& box : scene.left) {
    const auto found = blocks.find(box.object);
    if (found == blocks.end()) continue;
    sights.clear();
    const auto at = static_cast<std::size_t>(box.object);
    const FeatureObject& object = objects_[at];
    add_sights_on(object, {box.object, *pose_in_frame(object, frame)}, k, pose, landmarks_, sights);
    hide(scene, k, landmarks_, sights);
    std::erase_if(sights, [](const Sight& s) { return s.hidden[0]; });
    const OctaveCounts seen = count_by_octave(sights);
    Rng rng(hash_of(hash_of(options_.seed, 11), frame, at));
    for (int octave = 0; octave < kFeatureLevels; ++octave) {
      const auto o = static_cast<std::size_t>(octave);
      const double wanted = kDensity * still[o] * found->second / all;
      // Small objects have whole landmarks too, some of them.
      const double part = Rng(hash_of(hash_of(options_.seed, 12), at, o)).uniform();
      for (int i = seen[o]; i < static_cast<int>(wanted + part); ++i) add_to(box, octave, rng);
    }
  }
}

}  // namespace

LandmarkMap make_landmarks(const FeaturePath& path, const FeatureOptions& options,
                           const std::vector<FeatureObject>& objects,
                           const std::function<void(double)>& progress) {
  LandmarkMap landmarks(path.far * 1.4, objects.size());
  LandmarkMaker maker(path, options, objects, landmarks);
  const std::size_t frames = path.poses.size();
  for (std::size_t i = 0; i < frames; ++i) {
    maker.populate(i);
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(frames));
  }
  for (std::size_t i = 0; has_traffic(options) && i < frames; ++i) {
    maker.populate_objects(i);
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(frames));
  }
  return landmarks;
}

}  // namespace kys_slam::simulator
