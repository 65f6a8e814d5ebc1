// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <kys_slam/rigid3.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace kys_slam::simulator {

inline constexpr int kFeatureLevels = 8;
inline constexpr double kFeatureScale = 1.2;
inline constexpr double kMargin = 16;  // px, no features nearer to the border

/// Numbers of features or landmarks by octave.
using OctaveCounts = std::array<int, kFeatureLevels>;

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

/// Of a landmark what is read to find out that a camera does not see it: most are not seen.
struct LandmarkEntry {
  Eigen::Vector3d p_w;                    ///< as in Landmark
  float least_squared, greatest_squared;  ///< m^2, of the distance to the camera, rounded outwards
  std::int32_t id;
  std::int8_t face;  ///< as in Landmark

  /// True if the camera is too near or too far.
  [[nodiscard]] bool is_out_of_range(const Eigen::Vector3d& camera_centre) const {
    const double squared = (camera_centre - p_w).squaredNorm();
    return squared < least_squared || squared > greatest_squared;
  }
};

/// A landmark as a camera sees it.
struct Sight {
  std::int32_t id;
  float level;                   ///< octave, with its fraction
  double cosine;                 ///< of the angle from the cone's axis
  Eigen::Vector3d pixel;         ///< u, v, u in the right image
  Eigen::Vector3d p_c;           ///< m, left camera frame
  std::array<bool, 2> hidden{};  ///< by camera
};

/// True for a pixel where features are found.
inline bool within_margin(const StereoCamera& camera, double u, double v) {
  return u >= kMargin && v >= kMargin && u < camera.width - kMargin && v < camera.height - kMargin;
}

/// Whether the left camera sees a landmark, without regard to objects before it. The poses are
/// those of the camera in the frame that the landmark is in. Sets all of `sight` but id and hidden.
bool sees(const StereoCamera& camera, const Landmark& landmark, const Rigid3& T_a_c,
          const Rigid3& T_c_a, Sight& sight);

/// Number of a cell of a grid.
inline std::uint64_t cell_key(const Eigen::Vector3i& cell) {
  return (static_cast<std::uint64_t>(cell.x() & 0x1fffff) << 42) |
         (static_cast<std::uint64_t>(cell.y() & 0x1fffff) << 21) |
         static_cast<std::uint64_t>(cell.z() & 0x1fffff);
}

/// All landmarks of a world: those of the static world in a grid, those of objects by object.
class LandmarkMap {
 public:
  /// \param reach  m, no static landmark is seen from beyond
  /// \param objects  number of objects
  LandmarkMap(double reach, std::size_t objects)
      : reach_(reach), cell_(reach / 7), of_object_(objects) {}

  /// Adds a landmark; its id is the number of landmarks before.
  void add(const Landmark& landmark);

  [[nodiscard]] std::size_t size() const { return landmarks_.size(); }
  [[nodiscard]] const std::vector<Landmark>& all() const { return landmarks_; }
  [[nodiscard]] const Landmark& operator[](std::int32_t id) const {
    return landmarks_[static_cast<std::size_t>(id)];
  }
  [[nodiscard]] double reach() const { return reach_; }
  /// The landmarks of an object.
  [[nodiscard]] const std::vector<LandmarkEntry>& of_object(std::size_t object) const {
    return of_object_[object];
  }
  /// The static landmarks that a camera sees, in any order.
  [[nodiscard]] std::vector<Sight> static_sights(const StereoCamera& camera,
                                                 const Rigid3& T_w_c) const;
  /// Ids of the static landmarks within `radius` (m) of a point along each axis, and of some that
  /// are farther away, in any order.
  [[nodiscard]] std::vector<std::int32_t> static_near(const Eigen::Vector3d& p_w,
                                                      double radius) const;

 private:
  [[nodiscard]] Eigen::Vector3i cell_of(const Eigen::Vector3d& p) const {
    return (p / cell_).array().floor().cast<int>();
  }

  double reach_, cell_;  ///< m; size of a cell of the grid
  std::vector<Landmark> landmarks_;
  std::unordered_map<std::uint64_t, std::vector<LandmarkEntry>> grid_;
  std::vector<std::vector<LandmarkEntry>> of_object_;
};

}  // namespace kys_slam::simulator
