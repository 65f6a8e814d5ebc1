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

/// How much moves in a simulated drive.
enum class Traffic : std::uint8_t { kNone, kLight, kCity, kJam };

/// How features are simulated along a trajectory.
struct FeatureOptions {
  std::uint64_t seed = 1;
  std::string camera = "auto";  ///< kitti, euroc, auto: kitti for KITTI files, euroc for TUM files
  std::int64_t start = 0;       ///< first pose used
  std::int64_t frames = -1;     ///< poses used; -1: all
  std::int64_t every = 1;       ///< of the file's poses the first, and then each so many
  int features = 0;             ///< per image, about; 0: the camera's own (kitti 2000, euroc 1200)
  double pixel_noise = 0.25;    ///< sigma at octave 0, px; grows with the octave's scale
  double wander = 0.2;          ///< px, octave 0: how far a corner moves with the view of it
  double lens = 0.2;            ///< px: what calibration leaves of each lens' distortion
  double bit_noise = 0.05;      ///< probability that a bit of a descriptor flips
  double outliers = 0.55;       ///< share of features that belong to nothing seen again
  double dropout = 0.4;         ///< share of visible landmarks that a camera does not detect
  double repeats = 0.10;        ///< share of landmarks that look like others
  double rate = 10;             ///< Hz, for trajectories without time stamps
  double near = 0, far = 0;     ///< m, range of depths; 0: the camera's own (4-60, 0.8-12)
  Traffic traffic = Traffic::kNone;    ///< moving and parked objects
  std::vector<FeatureObject> objects;  ///< in their place, of the same frames (read_objects)
  int width = 0;                       ///< px of KITTI's images, the camera scaled with it; 0: 1241
  bool labelled = false;  ///< a class for every landmark: for perception. Traffic brings it along
};
/// For check_options(); the keys are the names of the command line.
void describe(kys::OptionList& list, FeatureOptions& options);

/// The camera's path, and what films it.
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

/// The boxes of a frame as the two cameras see them.
struct FrameScene {
  std::vector<SeenBox> left, right;
  BoxRaster left_raster, right_raster;
  float mover_share = 0;  ///< of the left image's area that objects which can move cover
};

/// Landmarks at random places along a path, and the features that a stereo camera finds on it.
/// Landmarks are made where a frame would see too few of them, in a first pass over the whole path,
/// so that a place seen again shows the same landmarks.
///
/// A landmark has a position, a cone of directions that it is seen from (12 to 45 degrees around
/// its axis: further aside it looks different, or something stands before it), and a distance at
/// which it is found at octave 0; nearer by 1.2^k it is found at octave k. It is not found from
/// beyond, nor at more than its own number of octaves or the last one. With the view of it the
/// corner moves by a fraction of a pixel, smoothly, so that errors do not average out from frame to
/// frame.
///
/// With traffic there are objects, solid boxes that hide what is behind and in them, each with
/// landmarks of its own on its faces, as many as the static world has on the same area of the
/// image. The static landmarks are those of the world without traffic.
class FeatureWorld {
 public:
  /// `progress(done)` is called with the share of frames done.
  FeatureWorld(const FeaturePath& path, const FeatureOptions& options,
               const std::function<void(double)>& progress = {});
  ~FeatureWorld();

  [[nodiscard]] std::size_t landmark_count() const;
  /// m, in the world, or in its object's frame.
  [[nodiscard]] Eigen::Vector3d landmark_position(std::int32_t id) const;
  /// The object that carries a landmark and takes it along; -1: none, it is of the static world.
  [[nodiscard]] std::int32_t object_of(std::int32_t id) const;
  /// The object that a landmark is seen as a part of: the one above, or without traffic the parked
  /// car around it; -1: none.
  [[nodiscard]] std::int32_t segment_of(std::int32_t id) const;
  /// Class of a landmark; kys::kVoidLabel: none. Of a world that is labelled.
  [[nodiscard]] std::uint16_t label_of(std::int32_t id) const;
  [[nodiscard]] const std::vector<FeatureObject>& objects() const;
  [[nodiscard]] const Scenery& scenery() const;  ///< of a world that is labelled
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
