// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/run_writer.h>
#include <kys_slam/system.h>
#include <kys_slam/util/atomic_file.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <limits>
#include <map>
#include <tuple>
#include <vector>

#include "arrays.h"
#include "bind.h"
#include "python_system.h"
#include "state_dicts.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

/// (N, 6, 6) array; NaN where there is none.
nb::ndarray<nb::numpy, double> covariances_to_numpy(
    const std::vector<FrameEstimate>& list, std::optional<RelativePose> FrameEstimate::*which) {
  std::vector<double> values;
  values.reserve(36 * list.size());
  for (const FrameEstimate& e : list) {
    RelativePose::Covariance C =
        RelativePose::Covariance::Constant(std::numeric_limits<double>::quiet_NaN());
    if (e.*which) C = (e.*which)->covariance;
    values.insert(values.end(), C.data(), C.data() + C.size());
  }
  return to_numpy(std::move(values), {list.size(), 6, 6});
}

int traverse(PyObject* self, visitproc visit, void* arg) {
  Py_VISIT(Py_TYPE(self));
  if (!nb::inst_ready(self)) return 0;
  Py_VISIT(nb::inst_ptr<Slam>(self)->callback().ptr());
  Py_VISIT(nb::inst_ptr<Slam>(self)->features().ptr());
  return 0;
}
int clear(PyObject* self) {
  if (nb::inst_ready(self)) nb::inst_ptr<Slam>(self)->forget_callback();
  return 0;
}
PyType_Slot slam_slots[] = {{Py_tp_traverse, reinterpret_cast<void*>(traverse)},
                            {Py_tp_clear, reinterpret_cast<void*>(clear)},
                            {0, nullptr}};

/// A C++ call without the GIL.
template <typename F>
auto without_gil(F&& f) {
  const nb::gil_scoped_release released;
  return f();
}

void bind_pipe(nb::module_& m) {
  const auto released = nb::call_guard<nb::gil_scoped_release>();
  nb::class_<PythonPipe>(m, "_ObservationPipe", "See python/src/observation_pipe.h.")
      .def(nb::init<int, bool, int>(), "descriptor"_a, "wait"_a, "jpeg_quality"_a)
      .def("finish", &PythonPipe::finish, released)
      .def_prop_ro("broken", &PythonPipe::broken)
      .def_prop_ro("error", &PythonPipe::error)
      .def_prop_ro("skipped", &PythonPipe::skipped);
}

}  // namespace

void bind_system(nb::module_& m) {
  m.def("_label_space_of_priors", &label_space_of_priors, "folder"_a);
  bind_settings(m);
  bind_report(m);
  bind_pipe(m);
  bind_guard(m);
  m.def("check_writable", &check_writable, "file"_a,
        "Raises InputError when the file cannot be written. Leaves no file.");
  nb::class_<Slam>(m, "System", "See kys_slam.System.", nb::type_slots(slam_slots))
      .def(nb::init<const StereoCamera&, const Settings&, const std::string&,
                    const std::optional<std::filesystem::path>&, bool, nb::object>(),
           "camera"_a, "settings"_a, "schedule"_a, "priors"_a.none(), "strict_priors"_a,
           "features"_a.none())
      .def("_feed", &Slam::feed)
      .def("_feed_frame", &Slam::feed_frame)
      .def("_add_segments", &Slam::add_segments, "frame"_a, "map"_a.none(), "segments"_a)
      .def("end_segments", &Slam::end_segments, "No more segments come: nothing is waited for.")
      .def("_set_observer", &Slam::set_observer, "callback"_a.none())
      .def("_add_pipe", &Slam::add_pipe)
      .def("_remove_pipe", &Slam::remove_pipe)
      .def(
          "finish", [](Slam& s) { without_gil([&] { s.system().finish(); }); },
          "Waits for the back end; what follows is final. No frame can be fed afterwards.")
      .def(
          "reports", [](Slam& s) { return without_gil([&] { return s.reports(); }); },
          "FrameReports of all frames fed; what the back end did is complete after finish().")
      .def("_objects",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().objects(); });
             using O = ObjectEstimate;
             std::vector<double> positions, velocities;
             for (const O& o : list) {
               positions.insert(positions.end(), o.position.begin(), o.position.end());
               velocities.insert(velocities.end(), o.velocity.begin(), o.velocity.end());
             }
             const std::size_t n = list.size();
             return nb::make_tuple(
                 column<std::int64_t>(list, [](const O& o) { return o.frame; }),
                 column<std::int32_t>(list, [](const O& o) { return o.instance; }),
                 column<std::uint16_t>(list, [](const O& o) { return o.label; }),
                 column<double>(list, [](const O& o) { return o.p_moving; }),
                 to_numpy(std::move(positions), {n, 3}), to_numpy(std::move(velocities), {n, 3}));
           })
      .def(
          "interrupt", [](Slam& s) { s.system().interrupt(); },
          "Requests that running optimisation stops early. From any thread.")
      .def("start_rig", &Slam::start_rig, "file"_a,
           "Before the first frame and any map: begins with the correction of the calibration that "
           "is in the file, as `kys-slam calibrate` writes it.")
      .def(
          "load_map",
          [](Slam& s, const std::filesystem::path& file, bool localize_only) {
            without_gil([&] { s.system().load_map(file, localize_only); });
          },
          "file"_a, "localize_only"_a = false,
          "Before the first frame, once: goes on with a map saved earlier.")
      .def(
          "save_map",
          [](Slam& s, const std::filesystem::path& file) {
            without_gil([&] { s.system().save_map(file); });
          },
          "file"_a, "After finish(): the whole map.")
      .def(
          "_save_map_or_beside",
          [](Slam& s, const std::filesystem::path& file, const std::filesystem::path& output) {
            without_gil([&] { save_map_or_beside(s.system(), file, output); });
          },
          "file"_a, "output"_a, "save_map, or the folder's saved.map when the file is refused.")
      .def("_trajectory",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().trajectory(); });
             using E = FrameEstimate;
             return nb::make_tuple(
                 column<double>(list, [](const E& e) { return e.timestamp; }),
                 poses_to_numpy(list, [](const E& e) { return e.T_w_c; }),
                 column<std::uint8_t>(list, [](const E& e) { return e.connected; }),
                 column<std::int64_t>(list, [](const E& e) { return e.submap; }),
                 covariances_to_numpy(list, &E::local), covariances_to_numpy(list, &E::motion));
           })
      .def("_keyframes",
           [](Slam& s) {
             const auto list = without_gil([&] { return s.system().keyframes(); });
             return nb::make_tuple(
                 column<double>(list, [](const TimedPose& p) { return p.timestamp; }),
                 poses_to_numpy(list, [](const TimedPose& p) { return p.T_w_c; }));
           })
      .def(
          "landmarks",
          [](Slam& s) {
            const auto points = without_gil([&] { return s.system().landmarks(); });
            std::vector<double> values;
            for (const Eigen::Vector3d& p : points)
              values.insert(values.end(), {p.x(), p.y(), p.z()});
            return to_numpy(std::move(values), {points.size(), 3});
          },
          "(N, 3) float64, m: landmarks of the sub-map the trajectory is expressed in.")
      .def("_snapshot",
           [](Slam& s) { return to_dict(without_gil([&] { return s.system().snapshot(); })); })
      .def("_rig", [](Slam& s) { return to_dict(without_gil([&] { return s.system().rig(); })); })
      .def_prop_ro(
          "submaps", [](Slam& s) { return without_gil([&] { return s.system().submaps(); }); },
          "number of sub-maps that were never connected")
      .def_prop_ro("settings", [](Slam& s) { return Settings(s.settings()); })
      .def("_write_run",
           [](Slam& s, const std::filesystem::path& folder, const std::string& sequence,
              const std::optional<std::tuple<Times, Poses>>& truth, double start_up_s,
              double wall_s, double cpu_s, const std::string& end_reason,
              const std::map<std::string, std::int64_t>& left_out,
              const std::vector<std::string>& warnings, const std::string& recording) {
             RunInfo info;
             info.sequence = sequence;
             info.recording = recording;
             info.start_up_s = start_up_s;
             info.wall_s = wall_s;
             info.cpu_s = cpu_s;
             info.complete = end_reason.empty();
             info.end_reason = end_reason;
             info.left_out = left_out;
             info.warnings = warnings;
             if (truth) info.ground_truth = to_poses(std::get<0>(*truth), std::get<1>(*truth));
             return s.write_run(folder, std::move(info));
           });
}

}  // namespace kys_slam
