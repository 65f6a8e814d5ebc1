// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/error.h>
#include <kys_slam/sequence.h>

#include "io/calibration_file.h"

namespace kys_slam {

RawCamera read_sensor_yaml(const std::filesystem::path& path) {
  try {
    const CalibrationFile file(path);
    RawCamera camera;
    file.read_pinhole(file.root(), "", camera);
    camera.T_b_s = file.rigid(file.numbers(file.root()["T_BS"], "T_BS"), "T_BS", 1);
    return camera;
  } catch (const YAML::Exception& error) {
    throw InputError(path.string() + ": " + error.what());
  }
}

}  // namespace kys_slam
