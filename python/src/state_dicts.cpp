// SPDX-License-Identifier: BSD-3-Clause
#include "state_dicts.h"

#include <kys_slam/rig_file.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <utility>
#include <vector>

#include "arrays.h"

namespace kys_slam {

nb::dict to_dict(const MapSnapshot& s) {
  nb::dict d;
  using K = MapSnapshot::KeyFrame;
  using L = MapSnapshot::Landmark;
  using E = MapSnapshot::Edge;
  d["frames"] = s.frames;
  d["main_submap"] = s.main_submap;
  d["keyframe_ids"] = column<std::uint32_t>(s.keyframes, [](const K& k) { return k.id; });
  d["keyframe_submaps"] = column<std::uint32_t>(s.keyframes, [](const K& k) { return k.submap; });
  d["keyframe_times"] = column<double>(s.keyframes, [](const K& k) { return k.timestamp; });
  d["keyframe_poses"] = poses_to_numpy(s.keyframes, [](const K& k) { return k.T_w_c; });
  std::vector<double> points;
  for (const L& l : s.landmarks) points.insert(points.end(), {l.p_w.x(), l.p_w.y(), l.p_w.z()});
  d["landmark_ids"] = column<std::uint32_t>(s.landmarks, [](const L& l) { return l.id; });
  d["landmark_submaps"] = column<std::uint32_t>(s.landmarks, [](const L& l) { return l.submap; });
  d["landmark_labels"] = column<std::uint16_t>(s.landmarks, [](const L& l) { return l.label; });
  d["landmark_instances"] =
      column<std::int32_t>(s.landmarks, [](const L& l) { return l.instance; });
  d["landmark_beliefs"] = column<float>(s.landmarks, [](const L& l) { return l.belief; });
  d["landmark_observations"] =
      column<std::uint32_t>(s.landmarks, [](const L& l) { return l.observations; });
  d["landmark_points"] = to_numpy(std::move(points), {s.landmarks.size(), 3});
  std::vector<std::uint32_t> edges;
  for (const E& e : s.edges) edges.insert(edges.end(), {e.keyframe, e.other});
  d["edges"] = to_numpy(std::move(edges), {s.edges.size(), 2});
  d["edge_shared"] = column<std::int32_t>(s.edges, [](const E& e) { return e.shared_landmarks; });
  d["edge_tree"] = column<std::uint8_t>(s.edges, [](const E& e) { return e.spanning_tree; });
  d["edge_loop"] = column<std::uint8_t>(s.edges, [](const E& e) { return e.loop; });
  return d;
}

nb::dict to_dict(const RigReport& report) {
  nb::dict d;
  const auto rows = [&](double RowFit::*value) {
    return report.rows ? nb::cast((*report.rows).*value) : nb::none();
  };
  d["corrected"] = report.corrected();
  d["rows_sigma_before"] = rows(&RowFit::sigma_before);
  d["rows_sigma_after"] = rows(&RowFit::sigma_after);
  d["rows_field"] = rows(&RowFit::field);
  const RigEstimate& known = report.known();
  nb::dict parameters;
  for (int k = 0; k < RigCorrection::kSize; ++k) {
    const RigParameterName& name = rig_parameter_names()[static_cast<std::size_t>(k)];
    const double variance = known.covariance(k, k);
    parameters[nb::str(name.name.data(), name.name.size())] = nb::make_tuple(
        known.correction.parameters()[k], variance > 0 ? nb::cast(std::sqrt(variance)) : nb::none(),
        nb::str(name.unit.data(), name.unit.size()));
  }
  d["parameters"] = parameters;
  d["offset_estimate"] = report.offset
                             ? nb::cast(nb::make_tuple(report.offset->value, report.offset->sigma,
                                                       report.offset->applied))
                             : nb::none();
  return d;
}

}  // namespace kys_slam
