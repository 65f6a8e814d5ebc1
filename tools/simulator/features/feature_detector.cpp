// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/features/feature_detector.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "simulator/traffic/object_motion.h"

namespace kys_slam::simulator {
namespace {

constexpr double kSteady = 0.85;  // of what hides a landmark of an object, the part that stays
                                  // while the view of it does
constexpr double kSteadyLevels = 0.25;  // octaves of distance over which a view stays
// Of features that are not seen again, those on objects that remain. Chosen as the density of
// landmarks on objects is.
constexpr double kObjectOutliers = 0.4;

constexpr int kFamilies = 400;          // descriptors that repeated landmarks share
constexpr double kFamilySpread = 0.06;  // bits by which members differ from their family

// Flips each bit with the probability given.
void flip_bits(kys::Descriptor& d, double probability, Rng& rng) {
  if (probability <= 0) return;
  const double k = 1.0 / std::log1p(-std::min(probability, 0.999));
  double at = 0;
  for (;;) {
    at += std::floor(std::log(1.0 - rng.uniform()) * k);
    if (at >= 256) return;
    const auto bit = static_cast<std::size_t>(at);
    d.words[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    at += 1;
  }
}

}  // namespace

OctaveCounts feature_quota(const FeaturePath& path, const FeatureOptions& options) {
  const int all = options.features > 0 ? options.features : path.features;
  const int features = static_cast<int>(all * (1 - options.outliers));
  OctaveCounts n{};
  double sum = 0;
  for (int i = 0; i < kFeatureLevels; ++i) sum += std::pow(kFeatureScale, -i);
  for (int i = 0; i < kFeatureLevels; ++i) {
    n[static_cast<std::size_t>(i)] =
        static_cast<int>(std::lround(features * std::pow(kFeatureScale, -i) / sum));
  }
  return n;
}

FeatureDetector::FeatureDetector(const FeaturePath& path, const FeatureOptions& options,
                                 const std::vector<FeatureObject>& objects,
                                 const LandmarkMap& landmarks, const TruePair* pair)
    : path_(path),
      options_(options),
      objects_(objects),
      landmarks_(landmarks),
      pair_(pair),
      quota_(feature_quota(path, options)) {
  for (std::size_t camera = 0; camera < 2; ++camera) {
    Rng rng(hash_of(options.seed, 9, camera));
    for (double& x : lenses_[camera].reshaped()) x = 0.5 * options.lens * rng.gaussian();
  }
}

void FeatureDetector::observe(std::size_t frame, int camera, const std::vector<Sight>& by_strength,
                              const BoxRaster* raster, FeatureColumns out) const {
  const std::vector<Sight> found = detect(frame, camera, by_strength);
  measure(frame, camera, found, out);
  Rng rng(hash_of(hash_of(options_.seed, 8, static_cast<std::uint64_t>(camera)), frame, 0));
  const double wrong =
      options_.outliers / (1 - options_.outliers) * static_cast<double>(found.size());
  add_outliers(static_cast<int>(wrong), rng, raster, out);
}

// Of the landmarks in view, strongest first, those that a camera detects: so many of each octave,
// but for some. The order of the result tells nothing about the landmarks.
std::vector<Sight> FeatureDetector::detect(std::size_t frame, int camera,
                                           const std::vector<Sight>& by_strength) const {
  OctaveCounts left = quota_;
  std::vector<Sight> found;
  Rng both(hash_of(options_.seed, 6, frame));
  Rng one(hash_of(hash_of(options_.seed, 10, static_cast<std::uint64_t>(camera)), frame, 0));
  for (const Sight& s : by_strength) {
    const bool seen = !both.chance(options_.dropout);
    const bool missed = one.chance(kMissed);
    if (s.hidden[static_cast<std::size_t>(camera)]) continue;
    const bool of_object = landmarks_[s.id].object >= 0;
    if (of_object ? !finds_on_object(s, frame, camera) : missed || !seen) continue;
    if (left[static_cast<std::size_t>(s.level)]-- > 0) found.push_back(s);
  }
  std::sort(found.begin(), found.end(), [&](const Sight& a, const Sight& b) {
    const int oa = static_cast<int>(a.level);
    const int ob = static_cast<int>(b.level);
    if (oa != ob) return oa < ob;
    return hash_of(options_.seed, frame, static_cast<std::uint64_t>(a.id)) <
           hash_of(options_.seed, frame, static_cast<std::uint64_t>(b.id));
  });
  return found;
}

// Whether a camera detects a landmark of an object. Vehicles ahead keep their distance, and what
// was found once is found again, unlike in a world that goes by.
bool FeatureDetector::finds_on_object(const Sight& s, std::size_t frame, int camera) const {
  const auto id = static_cast<std::uint64_t>(s.id);
  const auto side = static_cast<std::uint64_t>(camera);
  Rng phase(hash_of(options_.seed, 13, id));
  const auto view = static_cast<std::uint64_t>(s.level / kSteadyLevels + phase.uniform());
  const auto happens = [&](std::uint64_t stream, std::uint64_t state, double probability) {
    return Rng(hash_of(stream, id, state)).chance(probability);
  };
  return !happens(hash_of(options_.seed, 14), view, kSteady * options_.dropout) &&
         !happens(hash_of(options_.seed, 16, side), view, kSteady * kMissed) &&
         !happens(hash_of(options_.seed, 15), frame, (1 - kSteady) * options_.dropout) &&
         !happens(hash_of(options_.seed, 17, side), frame, (1 - kSteady) * kMissed);
}

void FeatureDetector::measure(std::size_t frame, int camera, const std::vector<Sight>& found,
                              FeatureColumns out) const {
  const Rigid3 T_c_w = path_.poses[frame].T_w_c.inverse();
  for (const Sight& s : found) {
    const Landmark& l = landmarks_[s.id];
    Rng rng(hash_of(hash_of(options_.seed, 5, static_cast<std::uint64_t>(camera)), frame,
                    static_cast<std::uint64_t>(s.id)));
    Keypoint k;
    const double level = s.level + 0.12 * rng.gaussian();
    k.octave =
        static_cast<std::uint8_t>(std::clamp(static_cast<int>(level), 0, kFeatureLevels - 1));
    const double sigma = options_.pixel_noise * std::pow(kFeatureScale, k.octave);
    const Eigen::Vector3d shift = wander(s);
    const Eigen::Vector2d image = image_of(s, camera);
    const Eigen::Vector2d p(image.x() + (camera == 0 ? shift.x() : shift.z()),
                            image.y() + shift.y());
    const Eigen::Vector2d bent = p + lens_error(camera, p);
    const double u = bent.x() + sigma * rng.gaussian();
    const double v = bent.y() + sigma * rng.gaussian();
    if (!within_margin(path_.camera, u, v)) continue;
    k.x = static_cast<float>(u);
    k.y = static_cast<float>(v);
    const Eigen::Vector3d& p_c = s.p_c;
    const Rigid3* T_w_o =
        l.object < 0 ? nullptr : pose_in_frame(objects_[static_cast<std::size_t>(l.object)], frame);
    const Eigen::Quaterniond turn =
        T_w_o == nullptr ? T_c_w.rotation : T_c_w.rotation * T_w_o->rotation;
    const Eigen::Vector3d t = turn * l.tangent.cast<double>();
    // Direction of the tangent's image.
    const double a =
        std::atan2(t.y() * p_c.z() - p_c.y() * t.z(), t.x() * p_c.z() - p_c.x() * t.z()) +
        0.05 * rng.gaussian();
    k.angle = static_cast<float>(a - 2 * std::numbers::pi * std::floor(a / (2 * std::numbers::pi)));
    if (k.angle >= static_cast<float>(2 * std::numbers::pi)) k.angle = 0;
    k.response = std::clamp(l.strength + 4 * static_cast<float>(rng.gaussian()), 7.0F, 255.0F);
    DescriptorOrigin origin;
    kys::Descriptor d = make_descriptor(s.id, origin);
    // The more it is seen from the side (0 to 1), the more its descriptor changes.
    const auto aside = static_cast<float>(std::acos(s.cosine) / std::acos(l.min_cosine));
    flip_bits(d, options_.bit_noise * (1 + aside * aside), rng);
    out.set.keypoints.push_back(k);
    out.set.descriptors.push_back(d);
    out.ids.push_back(s.id);
    out.origins.push_back(origin);
  }
}

kys::Descriptor FeatureDetector::make_descriptor(std::int32_t id, DescriptorOrigin& origin) const {
  const auto n = static_cast<std::uint64_t>(id);
  Rng rng(hash_of(options_.seed, 2, n));
  origin = {DescriptorOrigin::Kind::kOwn, 0};
  if (!rng.chance(options_.repeats)) return base_descriptor(origin, id, options_.seed);
  origin = {DescriptorOrigin::Kind::kFamily, static_cast<std::uint64_t>(rng.below(kFamilies))};
  kys::Descriptor d = base_descriptor(origin, id, options_.seed);
  flip_bits(d, kFamilySpread, rng);
  return d;
}

// Where the corner is found beside the landmark's image: px of (u, v, u in the right image). A
// smooth function of the view alone: the same place sees the same. The two images share most of it,
// and so do landmarks that stand together, on the same tree or in the same shadow.
Eigen::Vector3d FeatureDetector::wander(const Sight& sight) const {
  constexpr double kPeriod = 1.3;  // octaves of distance
  const Landmark& l = landmarks_[sight.id];
  const Eigen::Vector3i group = (l.p_w * (30 / path_.far)).array().floor().cast<int>();
  Rng rng(hash_of(options_.seed, 7, cell_key(group)));
  const double octaves = sight.level - std::log(l.max_distance) / std::log(kFeatureScale);
  const auto wave = [&] {
    return std::sin(2 * std::numbers::pi * (octaves / kPeriod + rng.uniform()));
  };
  const double size = options_.wander * std::pow(kFeatureScale, static_cast<int>(sight.level));
  const double u = size * wave();
  const double v = size * wave();
  return {u, v, u + 0.3 * size * wave()};
}

// Pixel of a landmark in the true cameras.
Eigen::Vector2d FeatureDetector::image_of(const Sight& sight, int camera) const {
  if (pair_ == nullptr) return {camera == 0 ? sight.pixel.x() : sight.pixel.z(), sight.pixel.y()};
  const Eigen::Vector4d seen = pair_->observe(sight.p_c);
  return camera == 0 ? Eigen::Vector2d(seen.head<2>()) : Eigen::Vector2d(seen.tail<2>());
}

// What calibration leaves of a lens' distortion at a pixel, px.
Eigen::Vector2d FeatureDetector::lens_error(int camera, const Eigen::Vector2d& p) const {
  const double x = 2 * p.x() / path_.camera.width - 1;
  const double y = 2 * p.y() / path_.camera.height - 1;
  return lenses_[static_cast<std::size_t>(camera)] *
         Eigen::Vector<double, 6>(1, x, y, x * x, x * y, y * y);
}

void FeatureDetector::add_outliers(int count, Rng& rng, const BoxRaster* raster,
                                   FeatureColumns out) const {
  for (int i = 0; i < count; ++i) {
    Keypoint k;
    k.x = static_cast<float>(rng.uniform(kMargin, path_.camera.width - kMargin - 1));
    k.y = static_cast<float>(rng.uniform(kMargin, path_.camera.height - kMargin - 1));
    k.angle = static_cast<float>(rng.uniform(0, 2 * std::numbers::pi - 1e-4));
    k.response = static_cast<float>(rng.uniform(7, 40));
    k.octave = static_cast<std::uint8_t>(rng.below(kFeatureLevels));
    const std::uint64_t key = rng.bits();
    if (raster != nullptr && raster->object_at(k.x, k.y) >= 0 &&
        Rng(hash_of(key, 18)).uniform() > kObjectOutliers) {
      continue;
    }
    out.set.keypoints.push_back(k);
    out.set.descriptors.push_back(expand_descriptor(key));
    out.ids.push_back(-1);
    out.origins.push_back({DescriptorOrigin::Kind::kState, rng.state()});
  }
}

}  // namespace kys_slam::simulator
