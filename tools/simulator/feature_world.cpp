#include "feature_world.h"

#include <kys_slam/error.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>
#include <unordered_map>

#include "euroc_rig.h"
#include "io/trajectory_file.h"
#include "rng.h"

namespace kys_slam::simulator {
namespace {

constexpr double kMargin = 16;          // px, no features nearer to the border
constexpr double kMinCone = 0.21;       // rad, half the angle a landmark is seen from: 12 degrees
constexpr double kMaxCone = 0.79;       // 45 degrees
constexpr double kShortSpan = 0.25;     // octaves that a landmark is found at, mean: half of them
constexpr double kLongSpan = 1.2;       // the others
constexpr double kMissed = 0.15;        // share of the features of one image missing in the other
constexpr double kFarthest = 1e6;       // m from the origin, of a pose
constexpr int kFamilies = 400;          // looks that repeated landmarks share
constexpr double kFamilySpread = 0.06;  // bits by which members differ from their family

struct Landmark {
  Eigen::Vector3d p_w;
  Eigen::Vector3f normal;   ///< axis of the cone it is seen from
  Eigen::Vector3f tangent;  ///< gives the feature its direction in the image
  float max_distance = 0;   ///< m, found at octave 0 from there
  float max_level = 0;      ///< octave (with its fraction) beyond which it is not found
  float min_cosine = 0;     ///< of half the cone's angle
  std::uint8_t strength = 0;
};

kys::Descriptor random_descriptor(std::uint64_t key) {
  kys::Descriptor d;
  for (std::size_t i = 0; i < 4; ++i) d.words[i] = hash_of(key, 0xdec0de, i);
  return d;
}

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

// Share of the features at each octave: the same density at every scale.
std::array<int, kFeatureLevels> quotas(int features) {
  std::array<int, kFeatureLevels> n{};
  double sum = 0;
  for (int i = 0; i < kFeatureLevels; ++i) sum += std::pow(kFeatureScale, -i);
  for (int i = 0; i < kFeatureLevels; ++i) {
    n[static_cast<std::size_t>(i)] =
        static_cast<int>(std::lround(features * std::pow(kFeatureScale, -i) / sum));
  }
  return n;
}

}  // namespace

void FeatureOptions::check() const {
  const auto require = [](bool good, const char* text) {
    if (!good) throw InputError(text);
  };
  require(camera == "auto" || camera == "kitti" || camera == "euroc",
          "--camera: must be auto, kitti or euroc");
  require(start >= 0, "--start: must not be negative");
  require(frames == -1 || frames > 0, "--frames: must be at least 1");
  require(every > 0, "--every: must be at least 1");
  require(features == 0 || (features >= 50 && features <= 20000),
          "--features: must lie between 50 and 20000");
  require(pixel_noise >= 0 && pixel_noise <= 20, "--pixel-noise: must lie between 0 and 20 px");
  require(wander >= 0 && wander <= 20, "--wander: must lie between 0 and 20 px");
  require(lens >= 0 && lens <= 20, "--lens: must lie between 0 and 20 px");
  require(bit_noise >= 0 && bit_noise <= 0.5, "--bit-noise: must lie between 0 and 0.5");
  require(outliers >= 0 && outliers <= 0.9, "--outliers: must lie between 0 and 0.9");
  require(dropout >= 0 && dropout <= 0.9, "--dropout: must lie between 0 and 0.9");
  require(repeats >= 0 && repeats <= 1, "--repeats: must lie between 0 and 1");
  require(rate >= 1e-3 && rate <= 1e4, "--rate: must lie between 0.001 and 10000 Hz");
  const auto depth_makes_sense = [](double d) { return d == 0 || (d >= 0.1 && d <= 1e4); };
  require(depth_makes_sense(near) && depth_makes_sense(far),
          "--near, --far: must lie between 0.1 and 10000 m");
  require(near == 0 || far == 0 || near < far, "--near: must be less than --far");
}

namespace {

// Numbers on the first line that is not a comment.
int count_columns(const std::filesystem::path& trajectory) {
  std::ifstream file(trajectory);
  if (!file) throw InputError("cannot read " + trajectory.string());
  std::string line;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::string word;
    int count = 0;
    while (words >> word) ++count;
    return count;
  }
  throw InputError(trajectory.string() + ": holds no poses");
}

}  // namespace

FeaturePath read_feature_path(const std::filesystem::path& trajectory,
                              const FeatureOptions& options) {
  options.check();
  FeaturePath path;
  const int columns = count_columns(trajectory);
  if (columns == 12) {
    const std::vector<Rigid3> poses = read_kitti_poses(trajectory);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      path.poses.push_back({static_cast<double>(i) / options.rate, poses[i]});
    }
  } else if (columns == 8) {
    path.poses = read_tum_poses(trajectory);
  } else {
    throw InputError(trajectory.string() + ": " + std::to_string(columns) +
                     " columns; KITTI has 12, TUM has 8");
  }
  const auto count = static_cast<std::int64_t>(path.poses.size());
  if (options.start >= count) {
    throw InputError(trajectory.string() + ": has " + std::to_string(count) + " poses, none at " +
                     std::to_string(options.start));
  }
  std::vector<TimedPose> used;
  for (std::int64_t i = options.start; i < count; i += options.every) {
    if (static_cast<std::int64_t>(used.size()) == options.frames) break;
    used.push_back(path.poses[static_cast<std::size_t>(i)]);
  }
  path.poses = std::move(used);
  for (const TimedPose& pose : path.poses) {
    if (pose.T_w_c.t().cwiseAbs().maxCoeff() < kFarthest) continue;
    throw InputError(trajectory.string() + ": a pose lies more than 1000 km from the origin");
  }
  const bool kitti = options.camera == "kitti" || (options.camera == "auto" && columns == 12);
  if (kitti) {
    path.camera = {1241, 376, 718.856, 718.856, 607.1928, 185.2157, 386.1448 / 718.856};
    path.ground = 1.65;
    path.features = 2000;
  } else {
    const StereoRectifier rectifier = euroc_rectifier();
    path.camera = rectifier.camera();
    path.near = 0.8;
    path.far = 12;
    if (columns == 8) {
      for (TimedPose& pose : path.poses) pose.T_w_c = pose.T_w_c * rectifier.T_b_c();
    }
  }
  if (options.features > 0) path.features = options.features;
  if (options.near > 0) path.near = options.near;
  if (options.far > 0) path.far = options.far;
  if (path.near >= path.far) throw InputError("--near: must be less than --far");
  return path;
}

struct FeatureWorld::Impl {
  FeaturePath path;
  FeatureOptions options;
  std::array<int, kFeatureLevels> quota{};
  std::array<Eigen::Matrix<double, 2, 6>, 2> lenses;  ///< px: quadratics over the image, -1 to 1
  std::vector<Landmark> landmarks;
  double cell = 1;
  double reach = 1;
  std::unordered_map<std::uint64_t, std::vector<std::int32_t>> grid;

  /// A landmark as a camera sees it.
  struct Sight {
    std::int32_t id;
    float level;            ///< octave, with its fraction
    float aside;            ///< angle from the cone's axis over half the cone's: 0 to 1
    Eigen::Vector3d pixel;  ///< u, v, u in the right image
  };

  static std::uint64_t cell_key(int x, int y, int z) {
    return (static_cast<std::uint64_t>(x & 0x1fffff) << 42) |
           (static_cast<std::uint64_t>(y & 0x1fffff) << 21) |
           static_cast<std::uint64_t>(z & 0x1fffff);
  }
  [[nodiscard]] Eigen::Vector3i cell_of(const Eigen::Vector3d& p) const {
    return (p / cell).array().floor().cast<int>();
  }

  [[nodiscard]] bool inside(double u, double v) const {
    return u >= kMargin && v >= kMargin && u < path.camera.width - kMargin &&
           v < path.camera.height - kMargin;
  }
  bool sees(const Landmark& l, const Rigid3& T_w_c, const Rigid3& T_c_w, Sight& sight) const;
  void visible(std::size_t frame, std::vector<Sight>& out) const;
  void add(std::size_t frame, int octave, Rng& rng);
  void populate(std::size_t frame, std::vector<Sight>& sights);
  [[nodiscard]] kys::Descriptor look(std::int32_t id) const;
  [[nodiscard]] Eigen::Vector2d lens_error(int camera, const Eigen::Vector2d& p) const;
  [[nodiscard]] Eigen::Vector3d wander(const Sight& sight) const;
  [[nodiscard]] std::vector<Sight> detect(std::size_t frame, int camera,
                                          const std::vector<Sight>& by_strength) const;
  void emit(std::size_t frame, int camera, const std::vector<Sight>& chosen, FeatureSet& set,
            std::vector<std::int32_t>& ids) const;
  void outliers(int count, Rng& rng, FeatureSet& set, std::vector<std::int32_t>& ids) const;
};

bool FeatureWorld::Impl::sees(const Landmark& l, const Rigid3& T_w_c, const Rigid3& T_c_w,
                              Sight& sight) const {
  const Eigen::Vector3d view = T_w_c.t() - l.p_w;
  const double distance = view.norm();
  if (distance >= l.max_distance || distance < 0.2) return false;
  const double level = std::log(l.max_distance / distance) / std::log(kFeatureScale);
  if (level >= kFeatureLevels || level >= l.max_level) return false;
  const double cosine = view.dot(l.normal.cast<double>()) / distance;
  if (cosine < l.min_cosine) return false;
  const Eigen::Vector3d p_c = T_c_w * l.p_w;
  if (p_c.z() < 0.2) return false;
  sight.pixel = path.camera.project_stereo(p_c);
  if (!inside(sight.pixel.x(), sight.pixel.y())) return false;
  sight.level = static_cast<float>(level);
  sight.aside = static_cast<float>(std::acos(std::min(1.0, cosine)) / std::acos(l.min_cosine));
  return true;
}

void FeatureWorld::Impl::visible(std::size_t frame, std::vector<Sight>& out) const {
  out.clear();
  const Rigid3& T_w_c = path.poses[frame].T_w_c;
  const Rigid3 T_c_w = T_w_c.inverse();
  const Eigen::Vector3i centre = cell_of(T_w_c.t());
  const int n = static_cast<int>(reach / cell) + 1;
  const double slack = cell * 0.87;  // half the diagonal of a cell
  const double spread = 0.5 * std::hypot(path.camera.width, path.camera.height) / path.camera.fx;
  for (int x = -n; x <= n; ++x) {
    for (int y = -n; y <= n; ++y) {
      for (int z = -n; z <= n; ++z) {
        const Eigen::Vector3i c = centre + Eigen::Vector3i(x, y, z);
        const Eigen::Vector3d p = T_c_w * Eigen::Vector3d((c.cast<double>().array() + 0.5) * cell);
        if (p.z() < -slack || p.head<2>().norm() > (p.z() + slack) * spread + 2 * slack) continue;
        const auto found = grid.find(cell_key(c.x(), c.y(), c.z()));
        if (found == grid.end()) continue;
        for (const std::int32_t id : found->second) {
          Sight s{};
          s.id = id;
          if (sees(landmarks[static_cast<std::size_t>(id)], T_w_c, T_c_w, s)) out.push_back(s);
        }
      }
    }
  }
}

// A new landmark in the view of a frame, to be found at `octave` from there.
void FeatureWorld::Impl::add(std::size_t frame, int octave, Rng& rng) {
  const StereoCamera& k = path.camera;
  const Rigid3& T_w_c = path.poses[frame].T_w_c;
  const double u = rng.uniform(kMargin, k.width - kMargin);
  const double v = rng.uniform(kMargin, k.height - kMargin);
  double depth = path.near * std::pow(path.far / path.near, rng.uniform());
  const double down = (v - k.cy) / k.fy;
  const bool on_ground = path.ground > 0 && down > 0 && depth * down > path.ground;
  if (on_ground) depth = path.ground / down;
  Landmark l;
  const Eigen::Vector3d p_c = k.back_project(u, v, depth);
  l.p_w = T_w_c * p_c;
  const Eigen::Vector3d view = -p_c.normalized();
  const auto deviate = [&] {
    return Eigen::Vector3d(rng.gaussian(), rng.gaussian(), rng.gaussian());
  };
  const double cone = rng.uniform(kMinCone, kMaxCone);
  l.min_cosine = static_cast<float>(std::cos(cone));
  Eigen::Vector3d normal = (view + 0.4 * std::tan(cone) * deviate()).normalized();
  if (normal.dot(view) < std::cos(0.8 * cone)) normal = view;
  const Eigen::Vector3d tangent = deviate().cross(normal).normalized();
  l.normal = (T_w_c.rotation * normal).cast<float>();
  l.tangent = (T_w_c.rotation * tangent).cast<float>();
  const double level = octave + rng.uniform(0.02, 0.98);
  l.max_distance =
      static_cast<float>(std::min(p_c.norm() * std::pow(kFeatureScale, level), reach - 1e-3));
  // Found for the first time somewhere in its span, most often at the beginning: from afar.
  const double span = -std::log(1.0 - rng.uniform()) * (rng.chance(0.5) ? kShortSpan : kLongSpan);
  l.max_level = static_cast<float>(level + 0.05 + span);
  const double strength = rng.uniform();
  l.strength = static_cast<std::uint8_t>(20 + 100 * strength * strength);
  const auto id = static_cast<std::int32_t>(landmarks.size());
  const Eigen::Vector3i c = cell_of(l.p_w);
  landmarks.push_back(l);
  grid[cell_key(c.x(), c.y(), c.z())].push_back(id);
}

void FeatureWorld::Impl::populate(std::size_t frame, std::vector<Sight>& sights) {
  visible(frame, sights);
  std::array<int, kFeatureLevels> found{};
  for (const Sight& s : sights) ++found[static_cast<std::size_t>(s.level)];
  Rng rng(hash_of(options.seed, 1, frame));
  for (int octave = 0; octave < kFeatureLevels; ++octave) {
    const auto o = static_cast<std::size_t>(octave);
    const int wanted = static_cast<int>(quota[o] * 1.05 / (1 - options.dropout) / (1 - kMissed));
    for (int i = found[o]; i < wanted; ++i) add(frame, octave, rng);
  }
}

FeatureWorld::FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
                           const std::function<void(double)>& progress)
    : impl_(std::make_unique<Impl>()) {
  options.check();
  impl_->path = path;
  impl_->options = options;
  const int features = options.features > 0 ? options.features : path.features;
  impl_->quota = quotas(static_cast<int>(features * (1 - options.outliers)));
  for (std::size_t camera = 0; camera < 2; ++camera) {
    Rng rng(hash_of(options.seed, 9, camera));
    for (double& x : impl_->lenses[camera].reshaped()) x = 0.5 * options.lens * rng.gaussian();
  }
  impl_->reach = path.far * 1.4;
  impl_->cell = impl_->reach / 7;
  std::vector<Impl::Sight> sights;
  for (std::size_t i = 0; i < path.poses.size(); ++i) {
    impl_->populate(i, sights);
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(path.poses.size()));
  }
}

FeatureWorld::~FeatureWorld() = default;

std::size_t FeatureWorld::landmark_count() const {
  return impl_->landmarks.size();
}

Eigen::Vector3d FeatureWorld::landmark_position(std::int32_t id) const {
  return impl_->landmarks.at(static_cast<std::size_t>(id)).p_w;
}

FeatureFileInfo FeatureWorld::info() const {
  return {impl_->path.camera, kFeatureScale, kFeatureLevels, impl_->options.seed,
          impl_->path.poses};
}

kys::Descriptor FeatureWorld::Impl::look(std::int32_t id) const {
  const auto n = static_cast<std::uint64_t>(id);
  Rng rng(hash_of(options.seed, 2, n));
  if (!rng.chance(options.repeats)) return random_descriptor(hash_of(options.seed, 3, n));
  kys::Descriptor d =
      random_descriptor(hash_of(options.seed, 4, static_cast<std::uint64_t>(rng.below(kFamilies))));
  flip_bits(d, kFamilySpread, rng);
  return d;
}

// Where the corner is found beside the landmark's image: px of (u, v, u in the right image). A
// smooth function of the view alone: the same place sees the same. The two images share most of it,
// and so do landmarks that stand together, on the same tree or in the same shadow.
Eigen::Vector3d FeatureWorld::Impl::wander(const Sight& sight) const {
  constexpr double kPeriod = 1.3;  // octaves of distance
  const Landmark& l = landmarks[static_cast<std::size_t>(sight.id)];
  const Eigen::Vector3i group = (l.p_w * (30 / path.far)).array().floor().cast<int>();
  Rng rng(hash_of(options.seed, 7, cell_key(group.x(), group.y(), group.z())));
  const double octaves = sight.level - std::log(l.max_distance) / std::log(kFeatureScale);
  const auto wave = [&] {
    return std::sin(2 * std::numbers::pi * (octaves / kPeriod + rng.uniform()));
  };
  const double size = options.wander * std::pow(kFeatureScale, static_cast<int>(sight.level));
  const double u = size * wave();
  const double v = size * wave();
  return {u, v, u + 0.3 * size * wave()};
}

// What calibration leaves of a lens' distortion at a pixel, px.
Eigen::Vector2d FeatureWorld::Impl::lens_error(int camera, const Eigen::Vector2d& p) const {
  const double x = 2 * p.x() / path.camera.width - 1;
  const double y = 2 * p.y() / path.camera.height - 1;
  return lenses[static_cast<std::size_t>(camera)] *
         Eigen::Vector<double, 6>(1, x, y, x * x, x * y, y * y);
}

void FeatureWorld::Impl::outliers(int count, Rng& rng, FeatureSet& set,
                                  std::vector<std::int32_t>& ids) const {
  for (int i = 0; i < count; ++i) {
    Keypoint k;
    k.x = static_cast<float>(rng.uniform(kMargin, path.camera.width - kMargin - 1));
    k.y = static_cast<float>(rng.uniform(kMargin, path.camera.height - kMargin - 1));
    k.angle = static_cast<float>(rng.uniform(0, 2 * std::numbers::pi - 1e-4));
    k.response = static_cast<float>(rng.uniform(7, 40));
    k.octave = static_cast<std::uint8_t>(rng.below(kFeatureLevels));
    set.keypoints.push_back(k);
    set.descriptors.push_back(random_descriptor(rng.bits()));
    ids.push_back(-1);
  }
}

void FeatureWorld::Impl::emit(std::size_t frame, int camera, const std::vector<Sight>& chosen,
                              FeatureSet& set, std::vector<std::int32_t>& ids) const {
  const Rigid3 T_c_w = path.poses[frame].T_w_c.inverse();
  for (const Sight& s : chosen) {
    const Landmark& l = landmarks[static_cast<std::size_t>(s.id)];
    Rng rng(hash_of(hash_of(options.seed, 5, static_cast<std::uint64_t>(camera)), frame,
                    static_cast<std::uint64_t>(s.id)));
    Keypoint k;
    const double level = s.level + 0.12 * rng.gaussian();
    k.octave =
        static_cast<std::uint8_t>(std::clamp(static_cast<int>(level), 0, kFeatureLevels - 1));
    const double sigma = options.pixel_noise * std::pow(kFeatureScale, k.octave);
    const Eigen::Vector3d shift = wander(s);
    const Eigen::Vector2d p(camera == 0 ? s.pixel.x() + shift.x() : s.pixel.z() + shift.z(),
                            s.pixel.y() + shift.y());
    const Eigen::Vector2d bent = p + lens_error(camera, p);
    const double u = bent.x() + sigma * rng.gaussian();
    const double v = bent.y() + sigma * rng.gaussian();
    if (!inside(u, v)) continue;
    k.x = static_cast<float>(u);
    k.y = static_cast<float>(v);
    const Eigen::Vector3d p_c = T_c_w * l.p_w;
    const Eigen::Vector3d t = T_c_w.rotation * l.tangent.cast<double>();
    // Direction of the tangent's image.
    const double a =
        std::atan2(t.y() * p_c.z() - p_c.y() * t.z(), t.x() * p_c.z() - p_c.x() * t.z()) +
        0.05 * rng.gaussian();
    k.angle = static_cast<float>(a - 2 * std::numbers::pi * std::floor(a / (2 * std::numbers::pi)));
    if (k.angle >= static_cast<float>(2 * std::numbers::pi)) k.angle = 0;
    k.response = std::clamp(l.strength + 4 * static_cast<float>(rng.gaussian()), 7.0F, 255.0F);
    kys::Descriptor d = look(s.id);
    // The more it is seen from the side, the more its look changes.
    flip_bits(d, options.bit_noise * (1 + s.aside * s.aside), rng);
    set.keypoints.push_back(k);
    set.descriptors.push_back(d);
    ids.push_back(s.id);
  }
}

// Of the landmarks in view, strongest first, those that a camera detects: so many of each octave,
// but for some. The order of the result tells nothing about the landmarks.
std::vector<FeatureWorld::Impl::Sight> FeatureWorld::Impl::detect(
    std::size_t frame, int camera, const std::vector<Sight>& by_strength) const {
  std::array<int, kFeatureLevels> left = quota;
  std::vector<Sight> found;
  Rng both(hash_of(options.seed, 6, frame));
  Rng one(hash_of(hash_of(options.seed, 10, static_cast<std::uint64_t>(camera)), frame, 0));
  for (const Sight& s : by_strength) {
    const bool seen = !both.chance(options.dropout);
    if (one.chance(kMissed) || !seen) continue;
    if (left[static_cast<std::size_t>(s.level)]-- > 0) found.push_back(s);
  }
  std::sort(found.begin(), found.end(), [&](const Sight& a, const Sight& b) {
    const int oa = static_cast<int>(a.level);
    const int ob = static_cast<int>(b.level);
    if (oa != ob) return oa < ob;
    return hash_of(options.seed, frame, static_cast<std::uint64_t>(a.id)) <
           hash_of(options.seed, frame, static_cast<std::uint64_t>(b.id));
  });
  return found;
}

FeatureFrame FeatureWorld::frame(std::size_t index) const {
  const Impl& w = *impl_;
  std::vector<Impl::Sight> sights;
  w.visible(index, sights);
  std::stable_sort(sights.begin(), sights.end(), [&](const Impl::Sight& a, const Impl::Sight& b) {
    const int sa = w.landmarks[static_cast<std::size_t>(a.id)].strength;
    const int sb = w.landmarks[static_cast<std::size_t>(b.id)].strength;
    return sa != sb ? sa > sb : a.id < b.id;
  });
  FeatureFrame out;
  const auto fill = [&](int camera, FeatureSet& set, std::vector<std::int32_t>& ids) {
    const std::vector<Impl::Sight> found = w.detect(index, camera, sights);
    w.emit(index, camera, found, set, ids);
    Rng rng(hash_of(hash_of(w.options.seed, 8, static_cast<std::uint64_t>(camera)), index, 0));
    const double wrong =
        w.options.outliers / (1 - w.options.outliers) * static_cast<double>(found.size());
    w.outliers(static_cast<int>(wrong), rng, set, ids);
  };
  fill(0, out.left, out.left_landmarks);
  fill(1, out.right, out.right_landmarks);
  return out;
}

}  // namespace kys_slam::simulator
