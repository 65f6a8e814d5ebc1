// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/evaluation.h>
#include <kys_slam/trajectory_file.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

nb::dict to_dict(const Statistics& s) {
  nb::dict d;
  d["rmse"] = s.rmse;
  d["mean"] = s.mean;
  d["median"] = s.median;
  d["std"] = s.std;
  d["min"] = s.min;
  d["max"] = s.max;
  return d;
}

nb::dict evaluate_arrays(const Times& reference_times, const Poses& reference, const Times& times,
                         const Poses& poses, const std::string& alignment, double max_difference,
                         std::size_t delta) {
  EvaluationOptions options;
  if (alignment == "none") {
    options.alignment = Alignment::kNone;
  } else if (alignment == "sim3") {
    options.alignment = Alignment::kSim3;
  } else if (alignment != "se3") {
    throw InputError("alignment '" + alignment + "': se3, sim3 or none");
  }
  if (delta < 1) throw InputError("rpe_delta must be at least 1");
  options.max_time_difference = max_difference;
  options.rpe_delta = delta;
  const Evaluation e =
      evaluate(to_poses(reference_times, reference), to_poses(times, poses), options);
  nb::dict d;
  d["pairs"] = e.pairs;
  d["scale"] = e.alignment.scale;
  d["ate_m"] = to_dict(e.ate);
  d["rpe_translation_m"] = to_dict(e.rpe_translation);
  d["rpe_rotation_deg"] = to_dict(e.rpe_rotation);
  d["kitti_segments"] = e.kitti.segments;
  d["kitti_translation_percent"] = e.kitti.translation_percent;
  d["kitti_rotation_deg_per_100m"] = e.kitti.rotation_deg_per_100m;
  d["reference_length_m"] = e.reference_length;
  d["estimate_length_m"] = e.estimate_length;
  return d;
}

}  // namespace

void bind_evaluation(nb::module_& m) {
  m.def("evaluate", &evaluate_arrays, "reference_times"_a, "reference"_a, "times"_a, "poses"_a,
        nb::kw_only(), "alignment"_a = "se3", "max_difference"_a = 0.01, "rpe_delta"_a = 1,
        "Errors of a trajectory against a reference: times (N,) s, poses (N, 4, 4) of the same "
        "camera. A dict of figures as evo's.");
  m.def(
      "read_tum",
      [](const std::filesystem::path& path) {
        const auto poses = read_tum_poses(path, Stamps::kMayRepeat);
        return nb::make_tuple(column<double>(poses, [](const TimedPose& p) { return p.timestamp; }),
                              poses_to_numpy(poses, [](const TimedPose& p) { return p.T_w_c; }));
      },
      "path"_a,
      nb::sig("def read_tum(path: str | os.PathLike) -> tuple[numpy.typing.NDArray[numpy.float64], "
              "numpy.typing.NDArray[numpy.float64]]"),
      "Times (N,) s and poses (N, 4, 4) of a TUM trajectory file.");
  m.def(
      "write_tum",
      [](const std::filesystem::path& path, const Times& times, const Poses& poses) {
        write_tum_poses(path, to_poses(times, poses));
      },
      "path"_a, "times"_a, "poses"_a, "Writes a TUM trajectory file.");
}

}  // namespace kys_slam
