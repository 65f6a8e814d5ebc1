#include "feature_world.h"

#include <kys_slam/check_options.h>
#include <kys_slam/error.h>
#include <kys_slam/trajectory_file.h>
#include <kys_slam/util/read_bytes.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <sstream>
#include <unordered_map>

#include "euroc_rig.h"
#include "rng.h"
#include "scenery.h"
#include "traffic.h"

namespace kys_slam::simulator {
namespace {

constexpr double kMargin = 16;       // px, no features nearer to the border
constexpr double kMinCone = 0.21;    // rad, half the angle a landmark is seen from: 12 degrees
constexpr double kMaxCone = 0.79;    // 45 degrees
constexpr double kShortSpan = 0.25;  // octaves that a landmark is found at, mean: half of them
constexpr double kLongSpan = 1.2;    // the others
constexpr double kMissed = 0.15;     // share of the features of one image missing in the other
constexpr double kBeside = 0.1;      // m, depth
constexpr double kFarthest = 1e6;    // m from the origin, of a pose
// What objects have more of than the static world, chosen so that a rendered street and the same
// street of features agree on the shares of keypoints and of matches that movers hold.
constexpr double kDensity = 1.7;         // of landmarks
constexpr double kObjectOutliers = 0.4;  // of features that are not seen again
constexpr double kSteady = 0.85;  // of what hides a landmark of an object, the part that stays
                                  // while the view of it does
constexpr double kSteadyLevels = 0.25;  // octaves of distance over which a view stays

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
  std::int8_t face = 0;      ///< of its object's box: axis + 1, negative on the lower side
  std::int32_t object = -1;  ///< then p_w, normal, tangent are in the object's frame
};

/// An object in a frame.
struct Presence {
  std::int32_t object;
  Rigid3 T_w_o;
};

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

void describe(kys::OptionList& list, FeatureOptions& o) {
  list.add("--camera", o.camera, "kitti, euroc or auto");
  list.add("--start", o.start, {0, 1e9});
  list.add("--frames", o.frames, {-1, 1e9});
  list.add("--every", o.every, {1, 1e9});
  list.add("--features", o.features, {0, 20000});
  list.add("--pixel-noise", o.pixel_noise, {0, 20}, "px");
  list.add("--wander", o.wander, {0, 20}, "px");
  list.add("--lens", o.lens, {0, 20}, "px");
  list.add("--bit-noise", o.bit_noise, {0, 0.5});
  list.add("--outliers", o.outliers, {0, 0.9});
  list.add("--dropout", o.dropout, {0, 0.9});
  list.add("--repeats", o.repeats, {0, 1});
  list.add("--rate", o.rate, {1e-3, 1e4}, "Hz");
  list.add("--near", o.near, {0, 1e4}, "m");
  list.add("--far", o.far, {0, 1e4}, "m");
  list.add("--width", o.width, {0, 2000}, "px");
  list.require(o.camera == "auto" || o.camera == "kitti" || o.camera == "euroc",
               "--camera must be auto, kitti or euroc");
  list.require(o.frames != 0, "--frames must be at least 1");
  list.require(o.features == 0 || o.features >= 50, "--features must be between 50 and 20000");
  list.require(o.width == 0 || o.width >= 200, "--width must be between 200 and 2000");
  const auto sensible = [](double depth) { return depth == 0 || depth >= 0.1; };
  list.require(sensible(o.near) && sensible(o.far), "--near, --far must be between 0.1 and 10000");
  list.require(o.near == 0 || o.far == 0 || o.near < o.far, "--near must be less than --far");
}

namespace {

// Numbers on the first line that is not a comment.
int count_columns(const std::filesystem::path& trajectory) {
  std::istringstream file(read_text(trajectory));
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

namespace {

// The camera with images of another width.
StereoCamera scaled(const StereoCamera& k, int width) {
  const double f = static_cast<double>(width) / k.width;
  return {width,     static_cast<int>(std::lround(f * k.height)),
          f * k.fx,  f * k.fy,
          f * k.cx,  f * k.cy,
          k.baseline};
}

}  // namespace

FeaturePath read_feature_path(const std::filesystem::path& trajectory,
                              const FeatureOptions& options) {
  check_options(options);
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
    if (options.width > 0) path.camera = scaled(path.camera, options.width);
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
  std::vector<FeatureObject> objects;
  std::vector<std::vector<std::int32_t>> landmarks_of;  ///< by object
  std::unique_ptr<Scenery> scenery;                     ///< of a labelled world
  std::vector<std::uint16_t> labels;                    ///< by landmark, of a labelled world
  std::vector<std::int32_t> parked_around;              ///< by static landmark, or empty

  /// A landmark as a camera sees it.
  struct Sight {
    std::int32_t id;
    float level;                   ///< octave, with its fraction
    float aside;                   ///< angle from the cone's axis over half the cone's: 0 to 1
    Eigen::Vector3d pixel;         ///< u, v, u in the right image
    Eigen::Vector3d p_c;           ///< m, left camera frame
    std::array<bool, 2> hidden{};  ///< by camera
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
  [[nodiscard]] bool has_traffic() const {
    return options.traffic != Traffic::kNone || !options.objects.empty();
  }
  [[nodiscard]] std::vector<Presence> present(std::size_t frame) const;
  void visible_on(const Presence& presence, std::size_t frame, std::vector<Sight>& out) const;
  [[nodiscard]] bool may_show(const Presence& presence, const FrameScene& scene) const;
  void hide(const FrameScene& scene, std::vector<Sight>& sights) const;
  void add_to(const SeenBox& box, int octave, Rng& rng);
  void populate_objects(std::size_t frame, std::vector<Sight>& sights);
  void label();
  [[nodiscard]] FrameScene scene(std::size_t frame) const;
  [[nodiscard]] Landmark new_landmark(const Rigid3& T_a_c, const Eigen::Vector3d& p_c, int octave,
                                      double farthest, Rng& rng) const;
  void add(std::size_t frame, int octave, Rng& rng);
  void populate(std::size_t frame, std::vector<Sight>& sights);
  [[nodiscard]] kys::Descriptor look(std::int32_t id, FeatureLook& origin) const;
  [[nodiscard]] Eigen::Vector2d lens_error(int camera, const Eigen::Vector2d& p) const;
  [[nodiscard]] Eigen::Vector3d wander(const Sight& sight) const;
  [[nodiscard]] bool finds_on_object(const Sight& s, std::size_t frame, int camera) const;
  [[nodiscard]] std::vector<Sight> detect(std::size_t frame, int camera,
                                          const std::vector<Sight>& by_strength) const;
  /// The features of one image, as a frame holds them.
  struct Columns {
    FeatureSet& set;
    std::vector<std::int32_t>& ids;
    std::vector<FeatureLook>& looks;
  };
  void emit(std::size_t frame, int camera, const std::vector<Sight>& chosen, Columns out) const;
  void outliers(int count, Rng& rng, const BoxRaster* raster, Columns out) const;
};

bool FeatureWorld::Impl::sees(const Landmark& l, const Rigid3& T_w_c, const Rigid3& T_c_w,
                              Sight& sight) const {
  // What costs least comes first: most landmarks are too far, or seen from aside.
  const Eigen::Vector3d view = T_w_c.t() - l.p_w;
  const double distance = view.norm();
  if (distance >= l.max_distance || distance < 0.2) return false;
  const double cosine = view.dot(l.normal.cast<double>()) / distance;
  if (cosine < l.min_cosine) return false;
  const Eigen::Vector3d p_c = T_c_w * l.p_w;
  if (p_c.z() < 0.2) return false;
  sight.pixel = path.camera.project_stereo(p_c);
  if (!inside(sight.pixel.x(), sight.pixel.y())) return false;
  const double level = std::log(l.max_distance / distance) / std::log(kFeatureScale);
  if (level >= kFeatureLevels || level >= l.max_level) return false;
  sight.p_c = p_c;
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

// A landmark at a point seen by the camera, to be found at `octave` from there. T_a_c: of the frame
// that the landmark is in; farthest: m, never found from beyond.
Landmark FeatureWorld::Impl::new_landmark(const Rigid3& T_a_c, const Eigen::Vector3d& p_c,
                                          int octave, double farthest, Rng& rng) const {
  Landmark l;
  l.p_w = T_a_c * p_c;
  const Eigen::Vector3d view = -p_c.normalized();
  const auto deviate = [&] {
    return Eigen::Vector3d(rng.gaussian(), rng.gaussian(), rng.gaussian());
  };
  const double cone = rng.uniform(kMinCone, kMaxCone);
  l.min_cosine = static_cast<float>(std::cos(cone));
  Eigen::Vector3d normal = (view + 0.4 * std::tan(cone) * deviate()).normalized();
  if (normal.dot(view) < std::cos(0.8 * cone)) normal = view;
  const Eigen::Vector3d tangent = deviate().cross(normal).normalized();
  l.normal = (T_a_c.rotation * normal).cast<float>();
  l.tangent = (T_a_c.rotation * tangent).cast<float>();
  const double level = octave + rng.uniform(0.02, 0.98);
  l.max_distance =
      static_cast<float>(std::min(p_c.norm() * std::pow(kFeatureScale, level), farthest));
  // Found for the first time somewhere in its span, most often at the beginning: from afar.
  const double span = -std::log(1.0 - rng.uniform()) * (rng.chance(0.5) ? kShortSpan : kLongSpan);
  l.max_level = static_cast<float>(level + 0.05 + span);
  const double strength = rng.uniform();
  l.strength = static_cast<std::uint8_t>(20 + 100 * strength * strength);
  return l;
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
  const Landmark l = new_landmark(T_w_c, k.back_project(u, v, depth), octave, reach - 1e-3, rng);
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

// Objects that are near enough to be seen.
std::vector<Presence> FeatureWorld::Impl::present(std::size_t frame) const {
  std::vector<Presence> out;
  const Rigid3& T_w_c = path.poses[frame].T_w_c;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const Rigid3* T_w_o = pose_in_frame(objects[i], frame);
    if (T_w_o == nullptr || (T_w_o->t() - T_w_c.t()).norm() > reach) continue;
    out.push_back({static_cast<std::int32_t>(i), *T_w_o});
  }
  return out;
}

FrameScene FeatureWorld::Impl::scene(std::size_t frame) const {
  std::vector<std::int32_t> ids;
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> halves;
  for (const Presence& p : present(frame)) {
    ids.push_back(p.object);
    poses.push_back(p.T_w_o);
    halves.push_back(objects[static_cast<std::size_t>(p.object)].half_size.cast<double>());
  }
  const Rigid3 T_l_w = path.poses[frame].T_w_c.inverse();
  const Rigid3 T_r_l(Eigen::Quaterniond::Identity(), {-path.camera.baseline, 0, 0});
  auto left = boxes_in_view(path.camera, T_l_w, ids, poses, halves);
  auto right = boxes_in_view(path.camera, T_r_l * T_l_w, ids, poses, halves);
  BoxRaster left_raster(path.camera, left);
  BoxRaster right_raster(path.camera, right);
  std::size_t covered = 0;
  for (const std::int32_t id : left_raster.objects()) {
    if (id < 0) continue;
    const FeatureObject& object = objects[static_cast<std::size_t>(id)];
    covered += object.kind == FeatureObject::Kind::kStatic ? 0 : 1;
  }
  const auto blocks = static_cast<float>(left_raster.objects().size());
  return {std::move(left), std::move(right), std::move(left_raster), std::move(right_raster),
          static_cast<float>(covered) / blocks};
}

// Landmarks on the faces of an object that a frame's cameras can see.
void FeatureWorld::Impl::visible_on(const Presence& presence, std::size_t frame,
                                    std::vector<Sight>& out) const {
  const auto at = static_cast<std::size_t>(presence.object);
  const FeatureObject& object = objects[at];
  const Rigid3 T_o_c = presence.T_w_o.inverse() * path.poses[frame].T_w_c;
  const Rigid3 T_c_o = T_o_c.inverse();
  const Eigen::Vector3d right_o = T_o_c * Eigen::Vector3d(path.camera.baseline, 0, 0);
  for (const std::int32_t id : landmarks_of[at]) {
    const Landmark& l = landmarks[static_cast<std::size_t>(id)];
    const int axis = std::abs(l.face) - 1;
    const double side = l.face > 0 ? 1 : -1;
    const double half = object.half_size[axis];
    const bool left_sees = side * T_o_c.t()[axis] > half;
    const bool right_sees = side * right_o[axis] > half;
    if (!left_sees && !right_sees) continue;
    Sight s{};
    s.id = id;
    if (object.kind == FeatureObject::Kind::kArticulated) {
      Landmark moved = l;
      moved.p_w = sway(object, l.p_w, path.poses[frame].timestamp);
      if (!sees(moved, T_o_c, T_c_o, s)) continue;
    } else if (!sees(l, T_o_c, T_c_o, s)) {
      continue;
    }
    s.hidden = {!left_sees, !right_sees};
    out.push_back(s);
  }
}

// Whether the left camera can see a landmark on an object. The limbs of people leave their box.
bool FeatureWorld::Impl::may_show(const Presence& presence, const FrameScene& scene) const {
  const FeatureObject& object = objects[static_cast<std::size_t>(presence.object)];
  return object.kind == FeatureObject::Kind::kArticulated ||
         std::ranges::binary_search(scene.left, presence.object, {}, &SeenBox::object);
}

// Marks what stands behind or inside a box, one camera at a time.
void FeatureWorld::Impl::hide(const FrameScene& scene, std::vector<Sight>& sights) const {
  constexpr double kSlack = 0.01;  // m
  for (Sight& s : sights) {
    const std::int32_t own = landmarks[static_cast<std::size_t>(s.id)].object;
    for (std::size_t camera = 0; camera < 2; ++camera) {
      const double u = camera == 0 ? s.pixel.x() : s.pixel.z();
      const double v = s.pixel.y();
      Eigen::Vector3d p = s.p_c;
      if (camera == 1) p.x() -= path.camera.baseline;
      for (const SeenBox& box : camera == 0 ? scene.left : scene.right) {
        if (s.hidden[camera]) break;
        if (box.nearest >= p.z() - kSlack) continue;
        if (box.object == own || u < box.u0 || u > box.u1 || v < box.v0 || v > box.v1) continue;
        s.hidden[camera] = depth_of_hit(box, p / p.z()) < p.z() - kSlack;
      }
    }
  }
}

// A new landmark on a box where the left camera sees it. A box that ends beside the camera gets its
// landmarks anywhere in the image: near parts that soon leave the image are not filled.
void FeatureWorld::Impl::add_to(const SeenBox& box, int octave, Rng& rng) {
  const StereoCamera& k = path.camera;
  const bool beside = box.nearest < kBeside;
  const double u0 = beside ? 0 : box.u0, u1 = beside ? k.width : box.u1;
  const double v0 = beside ? 0 : box.v0, v1 = beside ? k.height : box.v1;
  for (int attempt = 0; attempt < 8; ++attempt) {
    const double u = rng.uniform(std::max(u0, kMargin), std::min(u1, k.width - kMargin));
    const double v = rng.uniform(std::max(v0, kMargin), std::min(v1, k.height - kMargin));
    if (!inside(u, v)) continue;
    const Eigen::Vector3d ray((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1);
    const double depth = depth_of_hit(box, ray);
    if (!std::isfinite(depth) || depth < 0.2) continue;
    Landmark l = new_landmark(box.T_o_c, depth * ray, octave, kFarthest, rng);
    Eigen::Index axis = 0;
    (l.p_w.array() / box.half.array()).abs().maxCoeff(&axis);
    const bool upper = l.p_w[axis] > 0;
    l.p_w[axis] = (upper ? 1 : -1) * box.half[axis];
    // On a body the same corners are seen over a long way; a short life would mean that a car which
    // comes near needs thousands of them.
    l.max_level = static_cast<float>(octave + 1 - kLongSpan * std::log(1 - rng.uniform()));
    l.face = static_cast<std::int8_t>((axis + 1) * (upper ? 1 : -1));
    l.object = box.object;
    landmarks_of[static_cast<std::size_t>(box.object)].push_back(
        static_cast<std::int32_t>(landmarks.size()));
    landmarks.push_back(l);
    return;
  }
}

// Landmarks on an object by the area it covers, as dense as those of the static world that this
// frame could see there, and denser by kDensity.
void FeatureWorld::Impl::populate_objects(std::size_t frame, std::vector<Sight>& sights) {
  const FrameScene s = scene(frame);
  std::unordered_map<std::int32_t, int> blocks;
  for (const std::int32_t id : s.left_raster.objects()) {
    if (id >= 0) ++blocks[id];
  }
  if (blocks.empty()) return;
  visible(frame, sights);
  std::array<int, kFeatureLevels> still{};
  for (const Sight& sight : sights) ++still[static_cast<std::size_t>(sight.level)];
  const double all = static_cast<double>(s.left_raster.objects().size());
  for (const SeenBox& box : s.left) {
    const auto found = blocks.find(box.object);
    if (found == blocks.end()) continue;
    sights.clear();
    const auto at = static_cast<std::size_t>(box.object);
    visible_on({box.object, *pose_in_frame(objects[at], frame)}, frame, sights);
    hide(s, sights);
    std::array<int, kFeatureLevels> seen{};
    for (const Sight& sight : sights) {
      if (!sight.hidden[0]) ++seen[static_cast<std::size_t>(sight.level)];
    }
    Rng rng(hash_of(hash_of(options.seed, 11), frame, at));
    for (int octave = 0; octave < kFeatureLevels; ++octave) {
      const auto o = static_cast<std::size_t>(octave);
      const double wanted = kDensity * still[o] * found->second / all;
      // Small objects have whole landmarks too, some of them.
      const double part = Rng(hash_of(hash_of(options.seed, 12), at, o)).uniform();
      for (int i = seen[o]; i < static_cast<int>(wanted + part); ++i) add_to(box, octave, rng);
    }
  }
}

// Classes of all landmarks; without traffic also the parked car that a landmark is in.
void FeatureWorld::Impl::label() {
  scenery = std::make_unique<Scenery>(path, options.seed);
  for (const Landmark& l : landmarks) {
    labels.push_back(l.object >= 0 ? objects[static_cast<std::size_t>(l.object)].label
                                   : scenery->label_of(l.p_w));
  }
  if (has_traffic()) return;
  parked_around.assign(landmarks.size(), -1);
  for (std::size_t o = 0; o < objects.size(); ++o) {
    const Eigen::Vector3d half = objects[o].half_size.cast<double>();
    const Rigid3& T_w_o = objects[o].poses.front();
    const Rigid3 T_o_w = T_w_o.inverse();
    const Eigen::Vector3i low = cell_of(T_w_o.t() - Eigen::Vector3d::Constant(half.norm()));
    const Eigen::Vector3i high = cell_of(T_w_o.t() + Eigen::Vector3d::Constant(half.norm()));
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int z = low.z(); z <= high.z(); ++z) {
          const auto found = grid.find(cell_key(x, y, z));
          if (found == grid.end()) continue;
          for (const std::int32_t id : found->second) {
            const auto i = static_cast<std::size_t>(id);
            const Eigen::Vector3d p = T_o_w * landmarks[i].p_w;
            if ((p.cwiseAbs() - half).maxCoeff() > 0.02) continue;
            parked_around[i] = static_cast<std::int32_t>(o);
            labels[i] = objects[o].label;
          }
        }
      }
    }
  }
}

FeatureWorld::FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
                           const std::function<void(double)>& progress)
    : impl_(std::make_unique<Impl>()) {
  check_options(options);
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
  if (options.labelled || impl_->has_traffic()) {
    if (options.objects.empty()) impl_->objects = park_cars(path, options.seed);
    for (const FeatureObject& o : options.objects) impl_->objects.push_back(o);
    for (FeatureObject& o : options.objects.empty()
                                ? make_traffic(path, options.traffic, options.seed)
                                : std::vector<FeatureObject>{}) {
      impl_->objects.push_back(std::move(o));
    }
  }
  impl_->landmarks_of.resize(impl_->objects.size());
  for (std::size_t i = 0; impl_->has_traffic() && i < path.poses.size(); ++i) {
    impl_->populate_objects(i, sights);
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(path.poses.size()));
  }
  if (options.labelled || impl_->has_traffic()) impl_->label();
}

FeatureWorld::~FeatureWorld() = default;

std::size_t FeatureWorld::landmark_count() const {
  return impl_->landmarks.size();
}

Eigen::Vector3d FeatureWorld::landmark_position(std::int32_t id) const {
  return impl_->landmarks.at(static_cast<std::size_t>(id)).p_w;
}

std::int32_t FeatureWorld::object_of(std::int32_t id) const {
  return impl_->landmarks.at(static_cast<std::size_t>(id)).object;
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
FrameScene FeatureWorld::scene(std::size_t index) const {
  return impl_->scene(index);
}

FeatureTruth FeatureWorld::truth() const {
  FeatureTruth truth;
  truth.objects = impl_->objects;
  for (std::size_t i = 0; i < impl_->landmarks.size(); ++i) {
    const Landmark& l = impl_->landmarks[i];
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

kys::Descriptor FeatureWorld::Impl::look(std::int32_t id, FeatureLook& origin) const {
  const auto n = static_cast<std::uint64_t>(id);
  Rng rng(hash_of(options.seed, 2, n));
  origin = {FeatureLook::Kind::kOwn, 0};
  if (!rng.chance(options.repeats)) return base_descriptor(origin, id, options.seed);
  origin = {FeatureLook::Kind::kFamily, static_cast<std::uint64_t>(rng.below(kFamilies))};
  kys::Descriptor d = base_descriptor(origin, id, options.seed);
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

void FeatureWorld::Impl::outliers(int count, Rng& rng, const BoxRaster* raster, Columns out) const {
  for (int i = 0; i < count; ++i) {
    Keypoint k;
    k.x = static_cast<float>(rng.uniform(kMargin, path.camera.width - kMargin - 1));
    k.y = static_cast<float>(rng.uniform(kMargin, path.camera.height - kMargin - 1));
    k.angle = static_cast<float>(rng.uniform(0, 2 * std::numbers::pi - 1e-4));
    k.response = static_cast<float>(rng.uniform(7, 40));
    k.octave = static_cast<std::uint8_t>(rng.below(kFeatureLevels));
    const std::uint64_t key = rng.bits();
    if (raster != nullptr && raster->object_at(k.x, k.y) >= 0 &&
        Rng(hash_of(key, 18)).uniform() > kObjectOutliers) {
      continue;
    }
    out.set.keypoints.push_back(k);
    out.set.descriptors.push_back(expand_look(key));
    out.ids.push_back(-1);
    out.looks.push_back({FeatureLook::Kind::kState, rng.state()});
  }
}

void FeatureWorld::Impl::emit(std::size_t frame, int camera, const std::vector<Sight>& chosen,
                              Columns out) const {
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
    const Eigen::Vector3d& p_c = s.p_c;
    const Rigid3* T_w_o =
        l.object < 0 ? nullptr : pose_in_frame(objects[static_cast<std::size_t>(l.object)], frame);
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
    FeatureLook origin;
    kys::Descriptor d = look(s.id, origin);
    // The more it is seen from the side, the more its look changes.
    flip_bits(d, options.bit_noise * (1 + s.aside * s.aside), rng);
    out.set.keypoints.push_back(k);
    out.set.descriptors.push_back(d);
    out.ids.push_back(s.id);
    out.looks.push_back(origin);
  }
}

// Whether a camera detects a landmark of an object. Vehicles ahead keep their distance, and what
// was found once is found again, unlike in a world that goes by.
bool FeatureWorld::Impl::finds_on_object(const Sight& s, std::size_t frame, int camera) const {
  const auto id = static_cast<std::uint64_t>(s.id);
  const auto side = static_cast<std::uint64_t>(camera);
  Rng phase(hash_of(options.seed, 13, id));
  const auto view = static_cast<std::uint64_t>(s.level / kSteadyLevels + phase.uniform());
  Rng steady(hash_of(hash_of(options.seed, 14), id, view));
  Rng fresh(hash_of(hash_of(options.seed, 15), id, frame));
  Rng steady_one(hash_of(hash_of(options.seed, 16, side), id, view));
  Rng fresh_one(hash_of(hash_of(options.seed, 17, side), id, frame));
  return !steady.chance(kSteady * options.dropout) && !steady_one.chance(kSteady * kMissed) &&
         !fresh.chance((1 - kSteady) * options.dropout) &&
         !fresh_one.chance((1 - kSteady) * kMissed);
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
    const bool missed = one.chance(kMissed);
    if (s.hidden[static_cast<std::size_t>(camera)]) continue;
    const bool of_object = landmarks[static_cast<std::size_t>(s.id)].object >= 0;
    if (of_object ? !finds_on_object(s, frame, camera) : missed || !seen) continue;
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
  FeatureFrame out;
  std::optional<FrameScene> scene;
  if (w.has_traffic()) {
    scene = w.scene(index);
    for (const Presence& p : w.present(index)) {
      if (w.may_show(p, *scene)) w.visible_on(p, index, sights);
    }
    w.hide(*scene, sights);
    out.mover_share = scene->mover_share;
  }
  std::stable_sort(sights.begin(), sights.end(), [&](const Impl::Sight& a, const Impl::Sight& b) {
    const int sa = w.landmarks[static_cast<std::size_t>(a.id)].strength;
    const int sb = w.landmarks[static_cast<std::size_t>(b.id)].strength;
    return sa != sb ? sa > sb : a.id < b.id;
  });
  const auto fill = [&](int camera, Impl::Columns columns) {
    const std::vector<Impl::Sight> found = w.detect(index, camera, sights);
    w.emit(index, camera, found, columns);
    Rng rng(hash_of(hash_of(w.options.seed, 8, static_cast<std::uint64_t>(camera)), index, 0));
    const double wrong =
        w.options.outliers / (1 - w.options.outliers) * static_cast<double>(found.size());
    const BoxRaster* raster = !scene        ? nullptr
                              : camera == 0 ? &scene->left_raster
                                            : &scene->right_raster;
    w.outliers(static_cast<int>(wrong), rng, raster, columns);
  };
  fill(0, {out.left, out.left_landmarks, out.left_looks});
  fill(1, {out.right, out.right_landmarks, out.right_looks});
  return out;
}

}  // namespace kys_slam::simulator
