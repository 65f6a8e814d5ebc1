// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <string>

#include "common/command_line.h"
#include "map_file/map_file.h"
#include "simulator/common/rig_error.h"

namespace kys_slam {
namespace {

constexpr std::array kNames = {"u", "v", "disparity", "row"};

/// Errors of the correction of a map where it has features, and the same over their sigmas.
void report(const Map& map, const simulator::TruePair& truth) {
  std::array<double, 4> squares{}, normalised{};
  std::size_t count = 0;
  const StereoCamera& camera = map.camera();
  const RigEstimate& rig = map.rig_estimate();
  map.keyframes().for_each([&](KeyFrameId, const KeyFrame& keyframe) {
    const FrameFeatures& features = *keyframe.features;
    for (std::size_t i = 0; i < features.size(); ++i) {
      if (!features.has_stereo(i)) continue;
      const RigCorrection::Measured seen = features.measured(i);
      const Eigen::Vector2d ideal = truth.left_ideal(seen.u, seen.v);
      const double disparity = features.keypoint(i).x - features.u_right(i);
      const Eigen::Vector4d at =
          truth.observe(camera.back_project(ideal.x(), ideal.y(), camera.bf() / disparity));
      const RigCorrection::Measured exact{static_cast<float>(at[0]), static_cast<float>(at[1]),
                                          static_cast<float>(at[2]), static_cast<float>(at[3])};
      const RigCorrection::Ideal found = rig.correction.pair(exact);
      const Eigen::Vector4d error(found.u - ideal.x(), found.v - ideal.y(),
                                  found.u - found.u_right - disparity, found.row);
      const Eigen::Vector4d sigma = rig.sigma(exact);
      for (int c = 0; c < 4; ++c) {
        const auto k = static_cast<std::size_t>(c);
        squares[k] += error[c] * error[c];
        if (sigma[c] > 0) normalised[k] += error[c] * error[c] / (sigma[c] * sigma[c]);
      }
      ++count;
    }
  });
  const double n = count > 0 ? static_cast<double>(count) : 1;
  fmt::print("{} features with stereo\n{:12} {:>9} {:>11}\n", count, "", "rms px", "over sigma");
  for (std::size_t k = 0; k < 4; ++k) {
    fmt::print("{:12} {:9.4f} {:11.2f}\n", kNames[k], std::sqrt(squares[k] / n),
               std::sqrt(normalised[k] / n));
  }
}

int run(int argc, char** argv) {
  CLI::App app{
      "Errors of the correction of the cameras in a saved map, against the true cameras of a "
      "simulated sequence: root mean square where the map has features, and over the stated "
      "standard deviations."};
  std::string map_file, error_file;
  app.add_option("MAP", map_file, "map saved by a run (--save-map)")->required();
  app.add_option("ERROR", error_file, "rig_error.yaml of the sequence")->required();
  if (const auto status = parse_command_line(app, argc, argv)) return *status;
  const Map map = load_map(map_file);
  report(map, {map.camera(), simulator::make_rig_error(error_file, map.camera())});
  return 0;
}

}  // namespace
}  // namespace kys_slam

int main(int argc, char** argv) {
  return kys_slam::run_main("evaluate_rig", [&] { return kys_slam::run(argc, argv); });
}
