#pragma once

#include <kys/option_list.h>
#include <kys_slam/feature_file.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "boxes.h"

namespace kys_slam::simulator {

/// Amount of traffic in a simulated drive.
enum class Traffic : std::uint8_t { kNone, kLight, kCity, kJam };

/// How features are simulated along a trajectory.
struct FeatureOptions {
  std::uint64_t seed = 1;
  std::string camera = "auto";  ///< kitti, euroc, auto: kitti for KITTI files, euroc for TUM files
  std::int64_t start = 0;       ///< first pose used
  std::int64_t frames = -1;     ///< poses used; -1: all
  std::int64_t every = 1;       ///< use every N-th pose of the file, from the first
  int features =
      0;  ///< approximate number per image; 0: default of the camera (kitti 2000, euroc 1200)
  double pixel_noise = 0.25;  ///< sigma at octave 0, px; grows with the octave's scale
  double wander = 0.2;        ///< px, octave 0, viewpoint-dependent shift of a corner
  double lens = 0.2;          ///< px, residual lens distortion after calibration
  double bit_noise = 0.05;    ///< probability that a bit of a descriptor flips
  double outliers = 0.55;     ///< share of features that are never observed again
  double dropout = 0.4;       ///< share of visible landmarks that a camera does not detect
  double repeats = 0.10;      ///< share of landmarks that share a descriptor with others
  double rate = 10;           ///< Hz, for trajectories without time stamps
  double near = 0, far = 0;   ///< m, range of depths; 0: defaults of the camera (4-60, 0.8-12)
  Traffic traffic = Traffic::kNone;    ///< moving and parked objects
  std::vector<FeatureObject> objects;  ///< replace the traffic; same frames (read_objects)
  int width = 0;                       ///< px, of KITTI images; scales the camera; 0: 1241
  bool labelled = false;  ///< every landmark has a class, for perception; traffic implies it
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, FeatureOptions& options);

/// The camera and its path.
struct FeaturePath {
  StereoCamera camera;
  std::vector<TimedPose> poses;  ///< of the left camera
  double near = 4, far = 60;     ///< m
  double ground = 0;             ///< m below the camera; 0: none
  int features = 1200;           ///< per image
};

/// Reads a KITTI (12 columns) or TUM (8 columns) trajectory. With camera euroc a TUM file gives the
/// body frame, as EuRoC's ground truth does.
/// \throws InputError naming file and line (missing, not finite, stamps that do not increase).
FeaturePath read_feature_path(const std::filesystem::path& trajectory,
                              const FeatureOptions& options);

class Scenery;

/// The boxes of a frame in the views of the two cameras.
struct FrameScene {
  std::vector<SeenBox> left, right;
  BoxRaster left_raster, right_raster;
  float mover_share = 0;  ///< share of the left image covered by objects that can move
};

/// Landmarks at random positions along a path, and the features that a stereo camera observes. A
/// first pass over the whole path adds landmarks where a frame has too few, so that a revisited
/// place has the same landmarks.
///
/// A landmark has a position, a cone of viewing directions (12 to 45 degrees around its axis;
/// outside it is occluded or looks different), and a distance at which it is detected at octave 0.
/// Nearer by 1.2^k it is detected at octave k. It is not detected from a larger distance, nor
/// beyond its own number of octaves or the last octave. A smooth viewpoint-dependent shift of the
/// corner by a fraction of a pixel prevents errors from averaging out over frames.
///
/// Traffic adds objects: solid boxes that occlude landmarks behind and inside them. Each has its
/// own landmarks on its faces, with the image density of the static world. The static landmarks are
/// those of the world without traffic.
class FeatureWorld {
 public:
  /// `progress(done)` is called with the share of frames done.
  FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
               const std::function<void(double)>& progress = {});
  ~FeatureWorld();

  [[nodiscard]] std::size_t landmark_count() const;
  /// m, in the world, or in its object's frame.
  [[nodiscard]] Eigen::Vector3d landmark_position(std::int32_t id) const;
  /// The object to which a landmark is fixed; -1: none, it is static.
  [[nodiscard]] std::int32_t object_of(std::int32_t id) const;
  /// The object whose segment contains a landmark: object_of(), or without traffic the parked car
  /// around it; -1: none.
  [[nodiscard]] std::int32_t segment_of(std::int32_t id) const;
  /// Class of a landmark of a labelled world; kys::kVoidLabel: none.
  [[nodiscard]] std::uint16_t label_of(std::int32_t id) const;
  [[nodiscard]] const std::vector<FeatureObject>& objects() const;
  [[nodiscard]] const Scenery& scenery() const;  ///< of a labelled world
  [[nodiscard]] const FeaturePath& path() const;
  [[nodiscard]] FrameScene scene(std::size_t index) const;
  [[nodiscard]] FeatureTruth truth() const;
  /// The features of a frame; depends on the seed and the frame alone.
  [[nodiscard]] FeatureFrame frame(std::size_t index) const;
  [[nodiscard]] FeatureFileInfo info() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

inline constexpr int kFeatureLevels = 8;
inline constexpr double kFeatureScale = 1.2;

}  // namespace kys_slam::simulator
