// SPDX-License-Identifier: BSD-3-Clause
// export_rig: a corrected calibration in the formats of OpenCV, Kalibr and ROS.
#include <fmt/format.h>
#include <glog/logging.h>
#include <kys_slam/error.h>
#include <kys_slam/rig_file.h>
#include <kys_slam/run_main.h>
#include <kys_slam/util/atomic_file.h>
#include <kys_slam/util/paths.h>

#include <vector>

#include "common/command_line.h"
#include "fitted_rig.h"
#include "rig_formats.h"

namespace {

using namespace kys_slam;
namespace fs = std::filesystem;

int run(const fs::path& input, const std::string& format, const std::vector<fs::path>& outputs) {
  const std::size_t files = format == "camera_info" ? 2 : 1;
  if (outputs.size() != files) {
    throw InputError(
        fmt::format("--output: {} takes {}", format,
                    files == 2 ? "two files, of the left and of the right camera" : "one file"));
  }
  for (const fs::path& output : outputs) {
    if (is_same_path(input, output)) throw InputError(output.string() + ": is the input");
  }
  const StereoRig given = read_stereo_rig(std::vector<fs::path>{input});
  const auto own = given.rectified();
  const StereoCamera rectified =
      own ? *own : StereoRectifier(given.left, given.right, given.name).camera();
  const RigEstimate estimate = read_rig_correction(input, rectified);
  // Kalibr's lenses have four coefficients.
  const FittedRig fitted =
      fit_rig(given, rectified, estimate.correction, format == "kalibr" ? 4 : 5);
  if (format == "camera_info") {
    const auto both = to_camera_info(fitted.rig);
    for (std::size_t k = 0; k < files; ++k) write_file_atomic(outputs[k], both.at(k));
  } else {
    write_file_atomic(outputs[0],
                      format == "kalibr" ? to_kalibr(fitted.rig) : to_opencv(fitted.rig));
  }
  print_text(fmt::format("largest residual {:.4f} px, root mean square {:.4f} px\n", fitted.largest,
                         fitted.rms));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  FLAGS_minloglevel = google::GLOG_FATAL;
  return kys_slam::run_main("export_rig", [&] {
    CLI::App app(
        "Writes a calibration with a correction (calibrate_rig) for other programs: fits two "
        "cameras with lenses and their relative pose to it, and prints how well they fit.",
        "export_rig");
    fs::path input;
    std::string format;
    std::vector<fs::path> outputs;
    app.add_option("CALIBRATION", input, "output of calibrate_rig")->required();
    app.add_option("--format", format,
                   "opencv (stereoCalibrate), kalibr (camchain) or camera_info (ROS, two files)")
        ->required()
        ->check(CLI::IsMember({"opencv", "kalibr", "camera_info"}));
    app.add_option("-o,--output", outputs, "file to write")->required()->expected(1, 2);
    if (const auto status = parse_command_line(app, argc, argv)) return *status;
    return run(input, format, outputs);
  });
}
