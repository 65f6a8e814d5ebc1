// SPDX-License-Identifier: BSD-3-Clause
#include <kys_slam/settings.h>
#include <kys_slam/system.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/string_view.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <string>
#include <utility>

#include "arrays.h"
#include "bind.h"

namespace kys_slam {

using namespace nb::literals;

namespace {

nb::dict to_dict(const StageTimes& t) {
  nb::dict d;
  d["total"] = t.total;
  d["extract"] = t.extract;
  d["priors"] = t.priors;
  d["stereo"] = t.stereo;
  d["track"] = t.track;
  d["predict"] = t.predict;
  d["local_map"] = t.local_map;
  d["local_mapping"] = t.local_mapping;
  d["local_bundle"] = t.local_bundle;
  d["loop"] = t.loop;
  return d;
}

/// "true", "1200", "kys": the text of a value.
std::string setting_text(nb::handle value) {
  if (nb::isinstance<nb::bool_>(value)) return nb::cast<bool>(value) ? "true" : "false";
  return nb::cast<std::string>(nb::str(value));
}

}  // namespace

void bind_settings(nb::module_& m) {
  nb::class_<Settings>(m, "Settings", "Every setting by dotted name; each has a default.")
      .def(nb::init<>())
      .def(
          "__init__",
          [](Settings* self, const nb::dict& values) {
            Settings settings;
            for (const auto [key, value] : values) {
              settings.set(nb::cast<std::string>(key), setting_text(value));
            }
            new (self) Settings(std::move(settings));
          },
          "values"_a, "From a dict, e.g. {\"orb.features\": 1200, \"kys.mode\": \"kys\"}.")
      .def(
          "__setitem__",
          [](Settings& s, const std::string& key, nb::handle value) {
            s.set(key, setting_text(value));
          },
          "key"_a, "value"_a,
          "Raises InputError naming the unknown key, or the value that is not of its type.")
      .def(
          "__getitem__", [](const Settings& s, const std::string& key) { return s.get(key); },
          "key"_a, "The present value as text.")
      .def("__copy__", [](const Settings& s) { return Settings(s); })
      .def_static("indoor", &Settings::indoor, "Defaults for a drone or hand-held camera indoors.")
      .def("load", &Settings::load, "file"_a, "Reads a YAML file over the present values.")
      .def("get", &Settings::get, "key"_a, "The present value as text.")
      .def("check", &Settings::check, "Raises InputError naming the first that makes no sense.")
      .def("to_yaml", &Settings::to_yaml, "All as annotated YAML that load() reads back.")
      .def(
          "describe",
          [](const Settings& s) {
            nb::list rows;
            for (const auto& d : s.describe()) {
              rows.append(nb::make_tuple(d.key, d.value, d.unit, d.meaning));
            }
            return rows;
          },
          nb::sig("def describe(self) -> list[tuple[str, str, str, str]]"),
          "List of (key, value, unit, meaning).");
}

void bind_report(nb::module_& m) {
  nb::class_<RelativePose>(m, "RelativePose", "Pose of a frame relative to another one.")
      .def_ro("other", &RelativePose::other,
              "index of the other frame; -1: a keyframe of a loaded map")
      .def_prop_ro(
          "pose", [](const RelativePose& p) { return pose_to_numpy(p.T_other_c); },
          nb::rv_policy::move, "(4, 4) left camera to that of the other frame, m")
      .def_prop_ro(
          "covariance", [](const RelativePose& p) { return covariance_to_numpy(p.covariance); },
          nb::rv_policy::move,
          "(6, 6) of the increment [rotation (rad), translation (m)] on the right of `pose`, in "
          "the "
          "frame of this frame's left camera");
  nb::class_<FrameReport>(m, "FrameReport", "What came of one frame.")
      .def_ro("index", &FrameReport::index,
              "number of the frame as it was fed: of a Sequence, its position there")
      .def_ro("name", &FrameReport::name, "as given with the frame")
      .def_ro("timestamp", &FrameReport::timestamp, "s")
      .def_prop_ro(
          "status", [](const FrameReport& r) { return std::string(to_string(r.status)); },
          "\"started\", \"tracked\" or \"lost\"")
      .def_prop_ro(
          "lost", [](const FrameReport& r) { return r.status == FrameStatus::kLost; },
          "whether it has no pose")
      .def_ro("reason", &FrameReport::reason, "why it is lost, or how its pose was predicted")
      .def_ro("warning", &FrameReport::warning,
              "what is wrong with one of the images or the motion, \"\" nothing")
      .def_prop_ro(
          "integrity", [](const FrameReport& r) { return std::string(to_string(r.integrity)); },
          "how far the pose can be relied on: \"ok\", \"degraded\" or \"contradicted\"")
      .def_prop_ro(
          "integrity_reason",
          [](const FrameReport& r) { return std::string(to_string(r.integrity_reason)); },
          "why it is not \"ok\", \"\" it is")
      .def_ro("relocalised", &FrameReport::relocalised,
              "tracking had lost it, but it was recognised in the map")
      .def_ro("submap", &FrameReport::submap,
              "number of the sub-map in whose frame `pose` is, as known when tracked; -1: lost")
      .def_prop_ro(
          "pose", [](const FrameReport& r) { return pose_to_numpy(r.T_w_c); }, nb::rv_policy::move,
          "(4, 4) left camera to world, m, as estimated at this frame; meaningless when lost")
      .def_ro("local", &FrameReport::local,
              "RelativePose to the reference keyframe; None unless tracked")
      .def_ro("motion", &FrameReport::motion,
              "RelativePose to the last frame with a pose; None unless tracked, and after a "
              "relocalisation")
      .def_prop_ro(
          "covariance",
          [](const FrameReport& r) -> std::optional<nb::ndarray<nb::numpy, double>> {
            if (!r.local) return std::nullopt;
            return covariance_to_numpy(r.local->covariance);
          },
          nb::rv_policy::move, "(6, 6) that of `local`, or None")
      .def_prop_ro(
          "motion_covariance",
          [](const FrameReport& r) -> std::optional<nb::ndarray<nb::numpy, double>> {
            if (!r.motion) return std::nullopt;
            return covariance_to_numpy(r.motion->covariance);
          },
          nb::rv_policy::move, "(6, 6) that of `motion`, or None")
      .def_ro("keypoints", &FrameReport::keypoints, "of the left image")
      .def_ro("stereo_matches", &FrameReport::stereo_matches,
              "keypoints with a match in the right image")
      .def_ro("matches", &FrameReport::matches, "landmarks matched")
      .def_ro("inliers", &FrameReport::inliers, "matches that fit the pose")
      .def_ro("keyframe", &FrameReport::keyframe, "whether it became a keyframe")
      .def_ro(
          "segments_of", &FrameReport::segments_of,
          "index of the frame whose segments (add_segments) took effect with this one; -1: none")
      .def_ro("masked", &FrameReport::masked, "keypoints dropped by mode `mask` or by masks")
      .def_ro("prior_coverage", &FrameReport::prior_coverage,
              "0..1, share of keypoints with a valid label")
      .def_prop_ro(
          "times_ms", [](const FrameReport& r) { return to_dict(r.times); },
          "ms per stage; those of the back end are 0 until it has done with the frame")
      .def_prop_ro(
          "loop", [](const FrameReport& r) { return std::string(to_string(r.loop)); },
          "\"\", \"closed\" or \"merged\"; known when the back end has done with the keyframe")
      .def_ro("loop_frame", &FrameReport::loop_frame, "the frame it was closed with, -1: none")
      .def_ro("loop_gap_m", &FrameReport::loop_gap_m, "m, distance by which the loop was open");
}

}  // namespace kys_slam
