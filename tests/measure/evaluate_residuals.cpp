// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <kys_slam/stereo_camera.h>

#include <array>
#include <cmath>
#include <map>
#include <string>
#include <tuple>

#include "common/command_line.h"
#include "geometry/reprojection.h"
#include "map_file/map_file.h"

namespace kys_slam {
namespace {

/// Sums of squared residuals of u, v and disparity, px^2 of the octave.
struct Sums {
  std::array<double, 3> squares{};
  std::array<int, 3> counts{};

  void add(int component, double residual) {
    squares[static_cast<std::size_t>(component)] += residual * residual;
    ++counts[static_cast<std::size_t>(component)];
  }
  [[nodiscard]] double rms(int component) const {
    const auto k = static_cast<std::size_t>(component);
    return counts[k] > 0 ? std::sqrt(squares[k] / counts[k]) : 0;
  }
};

/// Correction of residuals after a fit: the square root of the number of residuals over the degrees
/// of freedom (residuals less unknowns).
double inflation(int residuals, int landmarks, std::size_t keyframes) {
  const double unknowns = 3.0 * landmarks + 6.0 * static_cast<double>(keyframes);
  return residuals > unknowns ? std::sqrt(residuals / (residuals - unknowns)) : 1;
}

void report(const Map& map) {
  std::map<std::tuple<bool, int>, Sums> table;  // by aligned, octave; -1: all octaves
  int residuals = 0, landmarks = 0;
  map.landmarks().for_each([&](LandmarkId, const Landmark& landmark) {
    if (landmark.observations.size() < 3) return;
    ++landmarks;
    for (const Observation& o : landmark.observations) {
      const KeyFrame& keyframe = map.keyframe(o.keyframe);
      const FrameFeatures& features = *keyframe.features;
      const Keypoint& k = features.keypoint(o.feature);
      const bool stereo = features.has_stereo(o.feature);
      const Eigen::Vector3d e = reprojection_error(map.camera(), keyframe.T_c_w * landmark.p_w, k.x,
                                                   k.y, stereo ? features.u_right(o.feature) : 0) /
                                map.scales().scale[k.octave];
      for (const int octave : {-1, static_cast<int>(k.octave)}) {
        Sums& sums = table[{features.is_aligned(o.feature), octave}];
        for (int c = 0; c < (stereo ? 3 : 2); ++c) sums.add(c, e[c]);
      }
      residuals += stereo ? 3 : 2;
    }
  });
  const double factor = inflation(residuals, landmarks, map.keyframes().size());
  fmt::print("{} residuals; factor for the degrees of freedom of the fit: {:.3f}\n\n", residuals,
             factor);
  fmt::print("| keypoints | octave | observations | u | v | disparity |\n");
  fmt::print("| --- | --- | --- | --- | --- | --- |\n");
  for (const auto& [key, sums] : table) {
    const auto [aligned, octave] = key;
    fmt::print("| {} | {} | {} | {:.3f} | {:.3f} | {:.3f} |\n", aligned ? "aligned" : "found",
               octave < 0 ? "all" : std::to_string(octave), sums.counts[0], factor * sums.rms(0),
               factor * sums.rms(1), factor * sums.rms(2));
  }
}

int run(int argc, char** argv) {
  CLI::App app{
      "Residuals of a saved map, landmarks with at least three observers: root mean square of u, v "
      "and disparity, px of the octave. They are multiplied by a factor that corrects for the "
      "degrees of freedom of the fit."};
  std::string file;
  app.add_option("MAP", file, "map saved by a run (--save-map)")->required();
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  report(load_map(file));
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_residuals", [&] { return kys_slam::run(argc, argv); });
}
